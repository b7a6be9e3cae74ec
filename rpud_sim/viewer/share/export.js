// @ts-check
/* What the plots show, as a picture and as a table. */
import { make } from "./dom.js";
import { placeOf } from "./plots.js";
import { colourOf, quantityOf } from "./quantities.js";

const HEAD = 22; // height of a title in a picture [px]

/** @param {string} name @param {Blob} content */
function save(name, content) {
  const link = make("a", { href: URL.createObjectURL(content), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1e4);
}

/** Save the values in view: a row for each time, and columns with ends of bands.
 * @param {import("./plots.js").TimePlot[]} plots @param {import("./marks.js").Range} range @param {string} name of the file */
export function saveCsv(plots, { start, end }, name) {
  const layers = plots.flatMap((plot) => plot.shownLayers.map((layer) => ({ layer, known: plot.known(layer), band: plot.known(layer)?.band ?? plot.seen.view?.band ?? "" })));
  const heads = ["time [s]"];
  const tables = layers.flatMap(({ layer: { quantity, kind }, known, band }) => {
    if (!known?.t.length) return [];
    const { label, unit, scale } = quantityOf(quantity), ends = band.includes("%") ? ["5 %", "95 %"] : ["least", "greatest"];
    if (kind === "steps") { // each lasts until the next one: also the first, which is of before
      const { t: times, mean } = known, t = [start, ...Array.from(times).filter((time) => time > start && time < end), end];
      known = { t, mean: t.map((time) => mean[placeOf(times, time)] ?? NaN) };
    }
    const columns = Object.entries({ "": known.mean, [ends[0]]: known.low, [ends[1]]: known.high }).filter(([, values]) => values);
    heads.push(...columns.map(([which]) => `"${[label.replaceAll('"', '""'), which].filter(Boolean).join(", ")}${unit && ` [${unit}]`}"`));
    return [[Array.from(known.t), ...columns.map(([, values]) => Array.from(values ?? [], (each) => each * scale))]];
  });
  const [times, ...columns] = tables.length ? uPlot.join(/** @type {any} */ (tables)) : [[]];
  const rows = Array.from(times, (time, row) => [time, ...columns.map((values) => values[row])]).filter(([time]) => Number(time) >= start && Number(time) <= end);
  const cell = (/** @type {number | null | undefined} */ value) => (Number.isFinite(value) ? String(Number(Number(value).toPrecision(12))) : "");
  save(`${name}.csv`, new Blob([[heads, ...rows.map((row) => row.map(cell))].map((row) => `${row.join(",")}\n`).join("")], { type: "text/csv" }));
}

/** Save the plots as they are drawn, with their titles.
 * @param {import("./plots.js").TimePlot[]} plots @param {string} drill @param {string} name of the file */
export function savePng(plots, drill, name) {
  const canvases = plots.flatMap((plot) => plot.plot?.ctx.canvas ?? []), ratio = uPlot.pxRatio;
  const whole = make("canvas", { width: Math.max(...canvases.map(({ width }) => width)) });
  whole.height = canvases.reduce((sum, { height }) => sum + height + HEAD * ratio, 0);
  const context = whole.getContext("2d");
  if (!context) return;
  Object.assign(context, { fillStyle: colourOf("paper"), font: `${13 * ratio}px system-ui, sans-serif`, textBaseline: "top" });
  context.fillRect(0, 0, whole.width, whole.height);
  let y = 0;
  plots.forEach((plot, place) => {
    context.fillStyle = colourOf("text");
    context.fillText([...(place ? [] : [drill]), plot.caption].join(": "), 10 * ratio, y + 4 * ratio);
    context.drawImage(canvases[place], 0, y + HEAD * ratio);
    y += canvases[place].height + HEAD * ratio;
  });
  whole.toBlob((picture) => picture && save(`${name}.png`, picture));
}
