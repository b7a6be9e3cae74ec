// @ts-check
/* Values as people read them: number, unit, colour and axis by the one table of quantities. */

const DIGITS = 3; // significant ones
export const LONG = 1e9; // from here on a number has an exponent
const USUAL = 0.999; // share of the values on each side that say how far an axis goes
const DOUBTFUL = 0.99; // the same, where some are garbage: others may be just as wrong
const BEYOND = 5; // times as far as usual: only values beyond are clipped
/** @type {Map<string, import("./frames.js").Quantity>} */
const table = new Map();

/** @param {import("./frames.js").Quantity[]} list */
export function setQuantities(list) { for (const quantity of list) table.set(quantity.name, quantity); }

/** Return a quantity of the table, or one without a unit for the signal of another program.
 * @param {string} name @returns {import("./frames.js").Quantity} */
export function quantityOf(name) { return table.get(name) ?? { name, label: name, unit: "", scale: 1, colour: "other", floor: 0, zero: false, credible: 1e100 }; }

/** Return a number with three significant digits, and with all of them before the point.
 * @param {number} value @param {boolean} keep zeros at the end, so that a number that changes keeps its length */
export function numberText(value, keep = false) {
  if (!value) return "0";
  const places = Math.max(0, DIGITS - 1 - Math.floor(Math.log10(Math.abs(value))));
  const plain = places <= 9 && Math.abs(value) < LONG;
  const text = plain ? value.toFixed(places) : value.toExponential(DIGITS - 1).replace(/([+-])(\d)$/, "$10$2");
  return (keep || !text.includes(".") || text.includes("e") ? text : text.replace(/\.?0+$/, "")).replace("-", "\u2212");
}

/** Return a value, given in SI units, as people read it; a dash for none.
 * @param {string} name of the quantity @param {number | null | undefined} value */
export function valueText(name, value, unit = true, keep = false) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "\u2013";
  const quantity = quantityOf(name);
  if (Math.abs(value) > quantity.credible) return "garbage";
  const text = numberText(Math.abs(value) < quantity.floor ? 0 : value * quantity.scale, keep);
  return unit && quantity.unit ? `${text}\u00a0${quantity.unit}` : text;
}

/** Return a value in SI units with a prefix that suits it; what is no number is as it was.
 * @param {any} value @param {string} unit */
export function siText(value, unit = "") {
  if (typeof value !== "number" || !unit) return value;
  const scaled = /^(m|m\/s|s|N|N s|N m|J|W|V|A|Hz|Pa)$/.test(unit) && value, power = scaled ? Math.floor(Math.log10(Math.abs(value)) / 3 + 1e-9) : 0;
  const place = Math.max(-3, Math.min(unit === "s" ? 0 : 3, power));
  return `${numberText(value / 1e3 ** place)} ${"nµm kMG"[place + 3].trim()}${unit}`;
}

/** Return a time of the run, as exact as a range of time shows it.
 * @param {number} time [s] @param {number} span [s] */
export function timeText(time, span) {
  const places = Math.max(0, Math.min(9, 2 - Math.floor(Math.log10(Math.max(span, 1e-9)))));
  return `${time.toFixed(places)}\u00a0s`;
}

/** Return a time of the run: in seconds, from ten minutes on as hours, minutes and seconds, as axes have it.
 * @param {number} time [s] @param {number} places of the seconds */
export function clockText(time, places = 0, long = time >= 600) {
  if (!long) return `${time.toFixed(places)}\u00a0s`;
  const whole = Math.floor(time + 1e-9), two = (/** @type {number} */ value) => String(Math.floor(value)).padStart(2, "0");
  return `${two(whole / 3600)}:${two((whole / 60) % 60)}:${two(whole % 60)}${places ? Math.max(time - whole, 0).toFixed(places).slice(1) : ""}`;
}

/** Return words of an identifier, such as a kind of fault. @param {string} name */
export function inWords(name) { return name.replaceAll("_", " "); }

/** Return the least round number that is not below a value.
 * @param {number} value @param {number[]} digits that are round, in the order of their sizes */
export function roundUp(value, digits = [1, 2, 5]) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * (digits.find((each) => each * power >= value) ?? 10);
}

/** Return ends of values, without what lies more than five times as far away as the usual ones.
 * @param {number[]} values in the unit that is shown @param {number} most that is no garbage @returns {[number, number]} */
export function clippedEnds(values, most = 1e100) {
  const kept = values.filter((value) => Math.abs(value) <= most).sort((a, b) => a - b), last = kept.length - 1, share = kept.length < values.length ? DOUBTFUL : USUAL;
  const [low, high] = [kept[Math.floor((1 - share) * last)], kept[Math.ceil(share * last)]], far = (BEYOND - 1) * (high - low) || Infinity;
  return [kept[0] < low - far ? low : kept[0], kept[last] > high + far ? high : kept[last]];
}

/** Return ends of an axis that hold values, at multiples of a round step.
 * @param {number} low @param {number} high @param {boolean} zero whether it includes zero @returns {[number, number]} */
export function axisRange(low, high, zero) {
  if (!(low <= high)) return [0, 1];
  if (zero) [low, high] = [Math.min(0, low), Math.max(0, high)];
  if (low === high) [low, high] = zero ? [low, low + 1] : [low - 0.5, high + 0.5];
  const step = roundUp((high - low) / 8);
  const top = Math.ceil((high + (high ? 0.2 * step : 0)) / step) * step;
  return [Math.floor((low - (low ? 0.2 * step : 0)) / step) * step, top];
}

/** @type {Map<string, string>} */
const colours = new Map();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => colours.clear());

/** Return a colour of the style sheet, for a canvas.
 * @param {string} name such as ``force`` @param {number} alpha */
export function colourOf(name, alpha = 1) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  const shade = Math.round(255 * alpha).toString(16).padStart(2, "0");
  return `${colours.get(name) || "#808080"}${alpha < 1 ? shade : ""}`;
}
