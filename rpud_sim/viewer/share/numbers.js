// @ts-check
/* Numbers of the last second, each with its extremes and how it went. */
import { make } from "./dom.js";
import { clippedEnds, quantityOf, valueText } from "./quantities.js";

const SVG = "http://www.w3.org/2000/svg";
const NAMES = ["depth", "penetration_rate", "impact_rate", "peak_force", "reacting_force", "power"];
const [WIDTH, HEIGHT] = [100, 24];

/** Row of numbers; one that the drill does not have is left out. */
export class Numbers {
  /** @param {HTMLElement} host list of descriptions */
  constructor(host) {
    this.tiles = NAMES.map((name) => {
      const [label, value, unit, ends] = [make("dt"), make("output", { ariaLive: "off" }), make("small"), make("small", { className: "ends" })];
      const spark = document.createElementNS(SVG, "svg");
      for (const [each, given] of [["viewBox", `0 0 ${WIDTH} ${HEIGHT}`], ["preserveAspectRatio", "none"], ["aria-hidden", "true"]]) spark.setAttribute(each, given);
      const line = spark.appendChild(document.createElementNS(SVG, "path"));
      value.dataset.number = name;
      const tile = make("div", { hidden: true }, label, make("dd", {}, value, unit, spark, ends));
      host.append(tile);
      return { name, tile, label, value, unit, ends, line };
    });
  }

  /** @param {Record<string, import("./frames.js").NumberOf | null>} numbers @param {import("./section.js").Hole | null} [hole] */
  draw(numbers, hole) {
    for (const { name, tile, label, value, unit, ends, line } of this.tiles) {
      const shown = numbers[name], quantity = quantityOf(name);
      tile.hidden = !shown;
      tile.style.setProperty("--of", `var(--${quantity.colour})`);
      label.textContent = quantity.label;
      unit.textContent = quantity.unit;
      const known = Number.isFinite(shown?.mean), { lost, garbage = 0 } = shown ?? {};
      value.textContent = garbage && !known ? "garbage" : valueText(name, shown?.mean, false, true);
      value.classList.toggle("long", value.textContent.length > 7);
      value.dataset.exact = String(shown?.mean);
      tile.dataset.old = String(!known);
      const [finest, greatest] = [shown?.least, shown?.greatest].map((end) => valueText(name, end, false)), places = greatest.split(".")[1]?.length;
      const least = finest.length > greatest.length && Number(finest) ? String(Number(Number(finest).toFixed(places))) : finest; // no more places than the greatest
      const faults = [lost && "messages lost", garbage && `${garbage} garbage`].filter(Boolean).join(", ");
      const span = !known || least === greatest ? "last 1 s" : `${least} to ${greatest}\nmin\u2013max, 1 s`;
      ends.textContent = faults || (name === "depth" && placeIn(hole, shown?.mean)) || span;
      line.setAttribute("d", sparkPath(shown?.spark ?? [], quantity.credible));
    }
  }
}

/** Return the layer that the bit is in, and how far the next one is.
 * @param {import("./section.js").Hole | null | undefined} hole @param {number | null | undefined} depth [m] */
function placeIn(hole, depth) {
  const layers = hole?.layers ?? [], last = layers.findLastIndex(({ from }) => from <= (depth ?? -1)), next = layers[last + 1];
  if (last < 0) return "";
  return `in ${layers[last].name}${next ? `\n${valueText("depth", next.from - (depth ?? 0))} to ${next.name}` : ""}`;
}

/** Return the outline of values above zero. @param {ArrayLike<number>} values @param {number} credible */
function sparkPath(values, credible) {
  const known = Array.from(values, (value, i) => [i, value]).filter(([, value]) => Number.isFinite(value));
  if (known.length < 2) return "";
  const heights = known.map(([, value]) => value);
  const [least, most] = clippedEnds(heights, credible), [low, high] = [Math.min(0, least), Math.max(1e-12, most)];
  const y = (/** @type {number} */ value) => (HEIGHT - 1 - ((Math.max(low, Math.min(high, value)) - low) / (high - low)) * (HEIGHT - 2)).toFixed(1);
  const x = (/** @type {number} */ i) => ((i / (values.length - 1)) * WIDTH).toFixed(1);
  return `M-9 ${y(0)}V${y(heights[0])}${known.map(([i, value]) => `L${x(i)} ${y(value)}`).join("")}H${WIDTH + 9}V${y(0)}`;
}
