// @ts-check
/* The column of plots: bands, means, outliers and steps over the time in view. */
import { make } from "./dom.js";
import { AXIS, END, axisOf, commandsOf, drawSpans, drawTimes, drawWords, sharedCursor, sizeOf, timeAxis } from "./marks.js";
import { axisRange, clippedEnds, colourOf, quantityOf, valueText } from "./quantities.js";

const SHRINK = 0.6; // an axis gets shorter when its values fill less of it
const NEAR = 1e-3; // of a shorter view the axis of the motion fits the indentation [s]

/** @typedef {import("./frames.js").PlotLayer} PlotLayer @typedef {import("./marks.js").Seen} Seen @typedef {import("./marks.js").Range} Range */

/** Return the place of the last time that is not after another; -1 for none.
 * @param {ArrayLike<number>} times @param {number} time */
export function placeOf(times, time) {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/** Return scaled values with null for what is no number, as plots need them, and for garbage far outside of an axis: no line leads there.
 * @param {ArrayLike<number> | undefined} values @param {number} count @param {number} scale
 * @param {[number, number] | null} ends of the axis @returns {(number | null)[]} */
export function columnOf(values, count, scale = 1, ends = null) {
  const [low, high] = ends ? [9 * ends[0] - 8 * ends[1], 9 * ends[1] - 8 * ends[0]] : [-Infinity, Infinity];
  const within = (/** @type {number} */ value) => Number.isFinite(value) && value >= low && value <= high;
  return Array.from({ length: count }, (_, i) => (values && within(values[i] * scale) ? values[i] * scale : null));
}

/** One plot, with its title or choice of quantities, and its legend. */
export class TimePlot {
  /** @param {import("./frames.js").PlotDefinition} definition @param {boolean} written whether times are written below it
   * @param {import("./marks.js").Listener} listener @param {string} chosen @param {(choice: string) => void} onChoice */
  constructor(definition, written, listener, chosen, onChoice) {
    this.definition = definition;
    this.written = written;
    this.listener = listener;
    /** @type {Seen} */ this.seen = {};
    /** @type {Range} */ this.range = { start: 0, end: 1 };
    /** @type {number | null} */ this.playhead = null;
    /** @type {[number, number] | null} */ this.ends = null; // of the axis of values
    this.span = 0; // for which these were fitted [s]
    /** @type {Set<string>} */ this.hidden = new Set(); // quantities that the reader does not want
    this.title = make("figcaption");
    this.area = make("div", { className: "area" });
    this.figure = make("figure", { className: "plot" }, this.title, this.area);
    this.figure.dataset.plot = definition.id;
    const options = definition.choices.map(({ title, id }) => new Option(title, id));
    this.select = make("select", { ariaLabel: "quantities of this plot" }, ...options);
    this.select.onchange = () => (this.choose(this.select.value), onChoice(this.select.value));
    this.choice = definition.choices[0];
    this.choose(chosen);
    new ResizeObserver(() => this.plot?.setSize(sizeOf(this.area))).observe(this.area); // whichever plot is there
  }

  /** Show other quantities. @param {string} id of the choice */
  choose(id) {
    this.choice = this.definition.choices.find((each) => each.id === id) ?? this.choice;
    this.select.value = this.choice.id;
    const { layers } = this.choice;
    const name = this.definition.choices.length > 1 ? this.select : make("b", { textContent: this.choice.title || this.definition.title });
    this.legend = layers.map((layer) => {
      const [name, value] = [make("span"), make("output", { ariaLive: "off" })];
      const entry = make("button", { type: "button", className: `key ${layer.kind}`, title: "hide or show" }, name, value);
      entry.style.setProperty("--of", `var(--${this.colour(layer)})`);
      entry.onclick = () => this.hide(layer.quantity);
      const own = layers.length === 1 || layer.label === (this.choice.title || this.definition.title);
      const words = own && layer.kind === "band" ? "mean" : layer.label;
      return { layer, entry, name, value, words };
    });
    const unit = make("small", { textContent: quantityOf(layers[0].quantity).unit });
    this.title.replaceChildren(name, unit, ...this.legend.map(({ entry }) => entry));
    this.plot?.destroy();
    this.ends = null;
    this.plot = new uPlot(this.options(), this.data(), this.area);
    this.draw(this.seen, this.range, this.playhead);
  }

  /** Title, unit and legend in words. */
  get caption() {
    const [{ quantity }] = this.choice.layers;
    return `${this.choice.title || this.definition.title} [${quantityOf(quantity).unit}]: ${(this.legend ?? []).map(({ name }) => name.textContent).join("; ")}`;
  }

  /** Layers that the reader has not hidden. */
  get shownLayers() { return this.choice.layers.filter(({ quantity }) => !this.hidden.has(quantity)); }

  /** Hide a quantity, or show it again. @param {string} quantity */
  hide(quantity) {
    if (!this.hidden.delete(quantity)) this.hidden.add(quantity);
    this.choose(this.choice.id);
  }

  /** @param {PlotLayer} layer */
  colour(layer) { return layer.colour || quantityOf(layer.quantity).colour; }

  /** @returns {uPlot.Options} */
  options() {
    /** @type {uPlot.Series[]} */ const series = [{}];
    /** @type {uPlot.Band[]} */ const bands = [];
    for (const layer of this.choice.layers) {
      const colour = this.colour(layer);
      const show = !this.hidden.has(layer.quantity);
      const single = () => !this.known(layer)?.low && this.seen.view?.detail !== "overview"; // values, not bins
      /** @type {uPlot.Series} */
      const shown = { show, stroke: () => colourOf(colour), width: 1.25, pxAlign: 0, points: { size: 4, width: 0, fill: () => colourOf(colour) } };
      if (shown.points && layer.kind === "steps") shown.points.show = false;
      else if (shown.points) shown.points.show = (plot, _, first, last) => single() && (last - first) * 6 < plot.bbox.width;
      if (layer.kind === "steps") shown.paths = uPlot.paths.stepped?.({ align: 1 });
      // Impacts are events: no line joins them.
      if (layer.quantity === "peak_force") shown.paths = (...of) => (single() ? null : uPlot.paths.linear?.()(...of) ?? null);
      series.push(shown);
      if (layer.kind !== "band") continue;
      const edge = { show, width: 0, pxAlign: 0, stroke: () => "transparent", points: { show: false } };
      series.push(edge, { ...edge });
      bands.push({ series: [series.length - 1, series.length - 2], fill: () => colourOf(colour, 0.25) });
    }
    const { hooks, ...shared } = sharedCursor(this.listener);
    return {
      ...sizeOf(this.area), ...shared, series, bands,
      scales: {
        x: { time: false, range: () => [this.range.start, this.range.end] },
        y: { dir: this.definition.id === "motion" ? -1 : 1, range: () => this.ends ?? [0, 1] }, // the rock is below
      },
      axes: [timeAxis(this.written), axisOf({ size: AXIS, gap: 6, space: 26 })],
      padding: [6, END, this.written ? 0 : 4, 0],
      hooks: { ...hooks, drawClear: [(plot) => drawSpans(plot, this.seen, this.shownLayers.flatMap((layer) => this.known(layer)?.holes ?? []))], draw: [(plot) => this.mark(plot)], setCursor: [(plot) => this.read(plot)] },
    };
  }

  /** @param {PlotLayer} layer @returns {import("./frames.js").Layer | undefined} what is known of it in the present view */
  known(layer) {
    const steps = layer.kind === "steps" ? this.seen.steps?.[layer.quantity] : undefined, shown = this.seen.view?.layers[layer.quantity];
    const before = layer.kind === "line" && (shown?.t[shown.t.length - 1] ?? Infinity) < this.range.start; // such as the mean of a second
    if (!steps?.t.length && !before) return shown;
    const [t, mean] = [Array.from(steps?.t ?? shown?.t ?? []), Array.from(steps?.v ?? shown?.mean ?? [])];
    return { t: [...t, Math.max(steps ? this.seen.now ?? 0 : this.range.end, t[t.length - 1])], mean: [...mean, mean[mean.length - 1]] }; // the last one lasts
  }

  /** @returns {uPlot.AlignedData} times of all layers joined, and their values */
  data() {
    const tables = this.choice.layers.map((layer) => {
      const { t, mean, low, high } = this.known(layer) ?? { t: [], mean: [] };
      const columns = layer.kind === "band" ? [mean, low, high] : [mean];
      return [Array.from(t), ...columns.map((values) => columnOf(values, t.length, quantityOf(layer.quantity).scale, this.ends))];
    });
    return /** @type {uPlot.AlignedData} */ (tables.length === 1 ? tables[0] : uPlot.join(/** @type {any} */ (tables)));
  }

  /** Layers to which the axis fits: in the view of a contact the tip may be far away. */
  get fitted() {
    const near = this.definition.id === "motion" && this.range.end - this.range.start < NEAR;
    return this.shownLayers.filter(({ quantity }) => !(near && quantity === "actuator"));
  }

  /** Fit the axis to what is in view; what lies beyond it is marked at its edges. */
  fit() {
    const { start, end } = this.range;
    const before = Math.abs((end - start) / this.span - 1) > 0.01 ? null : this.ends;
    this.span = end - start;
    /** @type {number[]} */ const values = [];
    for (const layer of this.fitted) {
      const { scale } = quantityOf(layer.quantity);
      const { t = [], mean, low, high, outliers } = this.known(layer) ?? {};
      const [first, last] = [Math.max(0, placeOf(t, start)), placeOf(t, end) + 1];
      for (const column of [mean, low, high])
        for (let i = first; column && i < last; i += 1) if (!Number.isNaN(column[i])) values.push(column[i] * scale);
      for (const value of outliers?.v ?? []) values.push(value * scale);
    }
    const zero = this.choice.layers.some((layer) => quantityOf(layer.quantity).zero);
    const { credible, scale } = quantityOf(this.choice.layers[0].quantity);
    const [low, high] = axisRange(...clippedEnds(values, credible * scale), zero);
    const fits = before && before[0] <= low && high <= before[1] && high - low > SHRINK * (before[1] - before[0]);
    this.ends = fits ? before : [low, high];
  }

  /** @param {Seen} seen @param {Range} range @param {number | null} playhead */
  draw(seen, range, playhead) {
    [this.seen, this.range, this.playhead] = [seen, range, playhead];
    this.fit();
    this.plot?.setData(this.data());
    for (const { layer, entry, name, words } of this.legend ?? []) {
      const known = this.known(layer);
      entry.hidden = !known?.t.length;
      entry.ariaPressed = String(!this.hidden.has(layer.quantity));
      const band = layer.kind === "band" && known?.low ? (known.band ?? seen.view?.band ?? "").replace("-", "\u2013") : "";
      name.textContent = [words, band].filter(Boolean).join(", ");
    }
    if (this.plot) this.read(this.plot);
  }

  /** Draw what lies over the data: commands, the playhead, outliers, and what is above the axis. @param {uPlot} plot */
  mark(plot) {
    const { ctx, bbox } = plot;
    const ratio = uPlot.pxRatio;
    const [failures, commands] = [true, false].map((failed) => commandsOf(this.seen).filter(({ kind }) => (kind === "failure") === failed).map(({ time }) => time));
    drawTimes(plot, commands, colourOf("command", 0.75), [3, 3]);
    drawTimes(plot, failures, colourOf("fault"));
    if (this.playhead !== null) drawTimes(plot, [this.playhead], colourOf("accent"));
    if (typeof this.seen.mark === "number") drawTimes(plot, [this.seen.mark], colourOf("text"), [2, 2]);
    if (this.definition.id === "peak_force") drawWords(plot, this.seen);
    ctx.save();
    for (const layer of this.fitted) {
      const { t, mean, low, high, outliers, garbage } = this.known(layer) ?? { t: [], mean: [] };
      const { scale } = quantityOf(layer.quantity), { min = -Infinity, max = Infinity } = plot.scales.y;
      const beyond = [0, 0]; // values above and below the axis
      ctx.fillStyle = colourOf(this.colour(layer), 0.8);
      for (const [times, tops, bottoms, dots] of /** @type {const} */ ([[t, high ?? mean, low ?? mean, false], [outliers?.t ?? [], outliers?.v ?? [], outliers?.v ?? [], true]]))
        for (let i = 0; i < times.length; i += 1) {
          if (times[i] < this.range.start || times[i] > this.range.end || Number.isNaN(tops[i])) continue;
          const x = plot.valToPos(times[i], "x", true), above = tops[i] * scale > max, below = bottoms[i] * scale < min;
          if (dots && !above && !below) this.dot(ctx, x, plot.valToPos(tops[i] * scale, "y", true));
          if (above) this.arrow(ctx, x, plot.valToPos(max, "y", true), bbox);
          if (below) this.arrow(ctx, x, plot.valToPos(min, "y", true), bbox);
          [beyond[0], beyond[1]] = [beyond[0] + Number(above), beyond[1] + Number(below)];
        }
      for (const time of Array.from(garbage?.t ?? [])) this.arrow(ctx, plot.valToPos(time, "x", true), bbox.top, bbox);
      const [above, below] = beyond;
      const texts = [garbage && `${garbage.count} garbage`, above && `${above} above`, below && `${below} below`, outliers?.more && `${outliers.more} outliers not drawn`].filter(Boolean);
      ctx.font = `${12 * ratio}px system-ui, sans-serif`;
      [ctx.textAlign, ctx.textBaseline] = ["right", "top"];
      ctx.fillText(texts.join(", "), bbox.left + bbox.width - 4 * ratio, bbox.top + 16 * ratio);
    }
    ctx.restore();
  }

  /** @param {CanvasRenderingContext2D} ctx @param {number} x @param {number} y */
  dot(ctx, x, y) {
    ctx.beginPath();
    ctx.arc(x, y, 1.3 * uPlot.pxRatio, 0, 7);
    ctx.fill();
  }

  /** Draw an arrow out of the plot, at its upper or lower edge. @param {CanvasRenderingContext2D} ctx @param {number} x
   * @param {number} y @param {uPlot.BBox} bbox */
  arrow(ctx, x, y, bbox) {
    const ratio = uPlot.pxRatio, side = y > bbox.top + 0.5 * bbox.height ? -ratio : ratio;
    ctx.beginPath();
    for (const [dx, dy] of [[-3, 4], [0, -1], [3, 4]]) ctx.lineTo(x + dx * ratio, y + dy * side);
    ctx.fill();
  }

  /** Write the values at the cursor, else at the playhead, into the legend. @param {uPlot} plot */
  read(plot) {
    const left = plot.cursor.left ?? -1;
    const time = left >= 0 ? plot.posToVal(left, "x") : this.playhead;
    if (plot.cursor.event) this.listener.point(left >= 0 ? time : null);
    for (const { layer, value } of this.legend ?? []) {
      const [at, marked] = [time, this.seen.mark ?? null].map((each) => this.valuesAt(layer, each));
      const [from, to] = (at?.slice(1) ?? []).map((each) => valueText(layer.quantity, each, false));
      const ends = layer.kind === "band" && from !== to ? ` (${from} to ${to})` : "";
      const more = at && marked ? `, \u0394\u00a0${valueText(layer.quantity, at[0] - marked[0])}` : "";
      const text = at ? valueText(layer.quantity, at[0]) + ends + more : "";
      if (value.textContent !== text) value.textContent = text;
    }
  }

  /** @param {PlotLayer} layer @param {number | null} time @returns {number[] | null} mean and ends of a layer there */
  valuesAt(layer, time) {
    const { t, mean, low = mean, high = mean } = this.known(layer) ?? { t: [], mean: [] };
    let place = time === null ? -1 : placeOf(t, time);
    if (time !== null && layer.kind !== "steps" && t[place + 1] - time < time - (t[place] ?? -Infinity)) place += 1; // the nearest
    return place < 0 ? null : [mean[place], low[place], high[place]];
  }
}

/** The plots, top to bottom; that of the motion is there while the view is short. */
export class PlotColumn {
  /** @param {HTMLElement} host @param {HTMLElement} motion figure of the latest motion
   * @param {import("./marks.js").Listener} listener @param {() => void} onChoice */
  constructor(host, motion, listener, onChoice) {
    this.host = host;
    this.motion = motion;
    this.listener = listener;
    this.onChoice = onChoice;
    /** @type {TimePlot[]} */ this.plots = [];
    /** @type {Record<string, string>} */ this.choices = {};
  }

  /** @param {import("./frames.js").PlotDefinition[]} definitions */
  define(definitions) {
    for (const { plot } of this.plots) plot?.destroy();
    this.plots = definitions.map((definition) => {
      const { id } = definition, last = definitions.findLast((each) => each.id !== "motion") ?? definition;
      const onChoice = (/** @type {string} */ choice) => ((this.choices[id] = choice), this.onChoice());
      return new TimePlot(definition, definition === last, this.listener, this.choices[id], onChoice);
    });
    this.host.replaceChildren(...this.plots.map(({ figure }) => figure));
  }

  /** Width of the area of data [px]. */
  get width() { return Math.max(100, (this.plots[0]?.area.clientWidth ?? 800) - AXIS - END); }

  /** Plots that are seen. */
  get shown() { return this.plots.filter(({ figure }) => !figure.hidden); }

  /** @param {Seen} seen @param {Range} range @param {number | null} playhead */
  draw(seen, range, playhead) {
    const exact = seen.view?.detail === "waveform"; // then the motion of the view is known, and stands in place of the latest
    for (const plot of this.plots) {
      if (plot.definition.id === "motion") [plot.figure.hidden, this.motion.hidden] = [!exact, exact];
      if (!plot.figure.hidden) plot.draw(seen, range, playhead);
    }
  }
}
