// @ts-check
/* Plots over one time axis: bands, means, outliers and steps, with the run's faults and commands. */
import { axisRange, colourOf, inWords, quantityOf, timeText, valueText } from "./quantities.js";

const AXIS = 52; // width of every y axis, as --axis [px]
const END = 10; // free on the right, as --end [px]
const TIMES = 18; // height of a time axis [px]
const CLIP = 0.999; // quantile of the values at which an axis ends
const SHRINK = 0.6; // an axis gets shorter when values fill less of it
const FONT = "11px system-ui, sans-serif";

/**
 * @typedef {import("./frames.js").PlotLayer} PlotLayer
 * @typedef {import("./frames.js").Layer} Layer
 * @typedef {Partial<import("./frames.js").Frame>} Seen what all frames of a run have said
 * @typedef {{start: number, end: number}} Range
 * @typedef {{onZoom: (start: number, end: number) => void, onAll: () => void,
 *   onCursor: (time: number | null) => void, onClick?: (time: number) => void}} Listener
 */

/** Return options of a time axis, whose grid all plots have.
 * @param {boolean} labelled @returns {uPlot.Axis} */
export function timeAxis(labelled) {
  return {
    stroke: () => colourOf("muted"),
    font: FONT,
    size: labelled ? TIMES : 0,
    gap: 4,
    space: 90,
    grid: { stroke: () => colourOf("rule"), width: 1 },
    ticks: { show: false },
    values: (_, splits, __, ___, step) =>
      labelled ? splits.map((value) => value.toFixed(decimals(step))) : splits.map(() => ""),
  };
}

/** @param {number} step @returns {number} digits after the point that tell its multiples apart */
function decimals(step) {
  return Math.max(0, Math.min(9, -Math.floor(Math.log10(step) + 1e-9)));
}

/** Return options of a cursor that all plots share; dragging along the time calls the listener.
 * @param {Listener} listener
 * @returns {{cursor: uPlot.Cursor, hooks: Partial<uPlot.Hooks.Arrays>}} */
export function sharedCursor(listener) {
  return {
    cursor: {
      y: false,
      points: { show: false },
      drag: { setScale: false, x: true, y: false, dist: 4, click: () => undefined },
      bind: {
        dblclick: () => () => {
          listener.onAll();
          return null;
        },
      },
      sync: {
        key: "time",
        scales: ["x", null],
        filters: { pub: (kind) => kind === "mousemove" || kind === "mouseleave" },
      },
    },
    hooks: {
      setSelect: [
        (plot) => {
          const { left, width } = plot.select;
          if (width > 4) listener.onZoom(plot.posToVal(left, "x"), plot.posToVal(left + width, "x"));
          plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
        },
      ],
      ready: [
        (plot) => plot.over.addEventListener("click", (event) => listener.onClick?.(plot.posToVal(event.offsetX, "x"))),
      ],
    },
  };
}

/** Shade faults and hatch gaps, below the data.
 * @param {uPlot} plot @param {Seen} seen */
export function drawSpans(plot, seen) {
  const { ctx, bbox } = plot;
  const place = clamped(plot);
  ctx.save();
  for (const fault of seen.faults ?? []) {
    const [from, to] = [place(fault.onset), place(fault.end ?? seen.now ?? Infinity)];
    ctx.fillStyle = colourOf("fault", 0.1);
    ctx.fillRect(from, bbox.top, Math.max(to - from, 1), bbox.height);
    ctx.fillStyle = colourOf("fault", 0.7);
    if (from > bbox.left) ctx.fillRect(from, bbox.top, uPlot.pxRatio, bbox.height);
  }
  for (const [begin, end] of seen.gaps ?? []) {
    const [from, to] = [place(begin), place(end)];
    ctx.save();
    ctx.beginPath();
    ctx.rect(from, bbox.top, Math.max(to - from, 1), bbox.height);
    ctx.clip();
    ctx.beginPath();
    for (let x = from - bbox.height; x < to; x += 6 * uPlot.pxRatio) {
      ctx.moveTo(x, bbox.top + bbox.height);
      ctx.lineTo(x + bbox.height, bbox.top);
    }
    ctx.strokeStyle = colourOf("gap", 0.6);
    ctx.lineWidth = uPlot.pxRatio;
    ctx.stroke();
    ctx.restore();
  }
  ctx.restore();
}

/** @param {uPlot} plot @returns {(time: number) => number} place of a time, at most at an edge */
function clamped({ bbox, scales }) {
  const { min = 0, max = 1 } = scales.x;
  return (time) => bbox.left + Math.max(0, Math.min(1, (time - min) / (max - min))) * bbox.width;
}

/** Draw upright lines at times.
 * @param {uPlot} plot @param {number[]} times @param {string} colour @param {number[]} dash */
export function drawTimes(plot, times, colour, dash = []) {
  const { ctx, bbox, scales } = plot;
  const { min = 0, max = 1 } = scales.x;
  ctx.save();
  ctx.beginPath();
  for (const time of times) {
    if (time < min || time > max) continue;
    const x = Math.round(plot.valToPos(time, "x", true)) + 0.5;
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
  }
  ctx.setLineDash(dash.map((length) => length * uPlot.pxRatio));
  ctx.strokeStyle = colour;
  ctx.lineWidth = uPlot.pxRatio;
  ctx.stroke();
  ctx.restore();
}

/** Scale values for a plot; what is not a number becomes a hole.
 * @param {ArrayLike<number> | undefined} values @param {number} count @param {number} scale
 * @returns {(number | null)[]} */
function column(values, count, scale) {
  /** @type {(number | null)[]} */
  const scaled = new Array(count).fill(null);
  if (values) for (let i = 0; i < count; i += 1) if (values[i] === values[i]) scaled[i] = values[i] * scale;
  return scaled;
}

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

/** One plot of the column, with its title, its choice of quantities and its legend. */
class TimePlot {
  /**
   * @param {import("./frames.js").PlotDefinition} definition
   * @param {boolean} labelled whether times are written below it
   * @param {Listener} listener
   * @param {(plot: string, choice: string) => void} onChoice
   */
  constructor(definition, labelled, listener, onChoice) {
    this.definition = definition;
    this.labelled = labelled;
    this.listener = listener;
    /** @type {Seen} */
    this.seen = {};
    /** @type {Range} */
    this.range = { start: 0, end: 1 };
    /** @type {number | null} */
    this.playhead = null;
    /** @type {Map<string, [number, number]>} */
    this.axes = new Map();
    this.span = 0;
    this.figure = document.createElement("figure");
    this.figure.className = "plot";
    this.figure.dataset.plot = definition.id;
    this.title = document.createElement("figcaption");
    this.area = document.createElement("div");
    this.area.className = "area";
    this.figure.append(this.title, this.area);
    this.choice = definition.choices[0];
    this.select = null;
    if (definition.choices.length > 1) {
      const select = document.createElement("select");
      select.ariaLabel = "quantities of this plot";
      for (const choice of definition.choices) select.add(new Option(choice.title, choice.id));
      select.onchange = () => {
        this.choose(select.value);
        onChoice(definition.id, select.value);
      };
      this.select = select;
    }
    this.choose(this.choice.id);
    new ResizeObserver(() => this.plot?.setSize(this.size())).observe(this.area);
  }

  size() {
    return { width: this.area.clientWidth || 300, height: this.area.clientHeight || 120 };
  }

  /** Show other quantities in this plot. @param {string} id of the choice */
  choose(id) {
    this.choice = this.definition.choices.find((each) => each.id === id) ?? this.choice;
    const { layers } = this.choice;
    const units = [...new Set(layers.map((layer) => quantityOf(layer.quantity).unit))];
    this.title.replaceChildren();
    const title = document.createElement("b");
    title.textContent = this.choice.title || this.definition.title;
    this.title.append(this.select ?? title);
    if (this.select) this.select.value = this.choice.id;
    if (units.length === 1 && units[0]) this.title.append(Object.assign(document.createElement("small"), { textContent: units[0] }));
    this.legend = layers.map((layer) => {
      const entry = document.createElement("span");
      entry.className = `key ${layer.kind}`;
      entry.style.setProperty("--of", `var(--${this.colour(layer)})`);
      const [name, value] = [document.createElement("span"), document.createElement("output")];
      entry.append(name, value);
      this.title.append(entry);
      return { layer, entry, name, value };
    });
    this.plot?.destroy();
    this.axes.clear();
    this.plot = new uPlot(this.options(units), this.data(), this.area);
    this.draw(this.seen, this.range, this.playhead);
  }

  /** @param {PlotLayer} layer */
  colour(layer) {
    return layer.colour || quantityOf(layer.quantity).colour;
  }

  /** @param {string[]} units of the layers; each has its own scale @returns {uPlot.Options} */
  options(units) {
    /** @type {uPlot.Series[]} */
    const series = [{}];
    /** @type {uPlot.Band[]} */
    const bands = [];
    for (const layer of this.choice.layers) {
      const colour = this.colour(layer);
      const scale = quantityOf(layer.quantity).unit || "y";
      /** @type {uPlot.Series} */
      const shown = { scale, stroke: () => colourOf(colour), width: 1.25, points: { size: 4, width: 0, fill: () => colourOf(colour) } };
      if (layer.kind === "steps" && uPlot.paths.stepped) shown.paths = uPlot.paths.stepped({ align: 1, extend: true });
      if (layer.kind === "steps") shown.points = { show: false };
      // Impacts are single events: no line joins them.
      if (layer.quantity === "peak_force")
        shown.paths = (...path) => (this.seen.view?.detail === "overview" ? uPlot.paths.linear?.()(...path) ?? null : null);
      series.push(shown);
      if (layer.kind !== "band") continue;
      const edge = { scale, width: 0, stroke: () => "transparent", points: { show: false } };
      series.push(edge, { ...edge });
      bands.push({ series: [series.length - 1, series.length - 2], fill: () => colourOf(colour, 0.25) });
    }
    /** @type {uPlot.Scales} */
    const scales = { x: { time: false, range: () => [this.range.start, this.range.end] } };
    for (const unit of units) scales[unit || "y"] = { range: () => this.axes.get(unit || "y") ?? [0, 1] };
    const { cursor, hooks } = sharedCursor(this.listener);
    return {
      ...this.size(),
      series,
      bands,
      scales,
      axes: [timeAxis(this.labelled), this.valueAxis(units[0] || "y", 3), ...units.slice(1, 2).map((unit) => this.valueAxis(unit || "y", 1))],
      padding: [6, units.length > 1 ? 0 : END, this.labelled ? 0 : 4, 0],
      legend: { show: false },
      cursor,
      hooks: {
        ...hooks,
        drawClear: [(plot) => drawSpans(plot, this.seen)],
        draw: [(plot) => this.mark(plot)],
        setCursor: [(plot) => this.point(plot)],
      },
    };
  }

  /** @param {string} scale @param {number} side @returns {uPlot.Axis} */
  valueAxis(scale, side) {
    return {
      scale,
      side,
      size: side === 3 ? AXIS : 40,
      stroke: () => colourOf("muted"),
      font: FONT,
      gap: 6,
      space: 26,
      grid: { show: side === 3, stroke: () => colourOf("rule"), width: 1 },
      ticks: { show: false },
      values: (_, splits, __, ___, step) => splits.map((value) => value.toFixed(decimals(step)).replace("-", "\u2212")),
    };
  }

  /** @param {PlotLayer} layer @returns {Layer | undefined} what is known of it in the present view */
  layer(layer) {
    const steps = layer.kind === "steps" ? this.seen.steps?.[layer.quantity] : undefined;
    return steps ? { t: steps.t, mean: steps.v } : this.seen.view?.layers[layer.quantity];
  }

  /** @returns {uPlot.AlignedData} times of all layers joined, and their values */
  data() {
    /** @type {any[]} */
    const tables = [];
    for (const layer of this.choice.layers) {
      const known = this.layer(layer);
      const { scale } = quantityOf(layer.quantity);
      const count = known?.t.length ?? 0;
      const table = [known ? Array.from(known.t) : [], column(known?.mean, count, scale)];
      if (layer.kind === "steps" && count && (this.seen.now ?? 0) > table[0][count - 1]) {
        table[0].push(/** @type {number} */ (this.seen.now)); // the last value lasts
        table[1].push(table[1][count - 1]);
      }
      if (layer.kind === "band") table.push(column(known?.low, count, scale), column(known?.high, count, scale));
      tables.push(table);
    }
    return tables.length === 1 ? tables[0] : uPlot.join(tables, tables.map((table) => table.map(() => 1)));
  }

  /** Fit the axes to what is in view; values above the 99.9 % quantile are marked at the edge. */
  fit() {
    /** @type {Map<string, {values: number[], zero: boolean}>} */
    const found = new Map();
    for (const layer of this.choice.layers) {
      const quantity = quantityOf(layer.quantity);
      const known = this.layer(layer);
      const scale = found.get(quantity.unit || "y") ?? { values: [], zero: false };
      found.set(quantity.unit || "y", scale);
      scale.zero ||= quantity.zero;
      if (!known) continue;
      const first = layer.kind === "steps" ? Math.max(0, placeOf(known.t, this.range.start)) : 0;
      for (const values of [known.mean, known.low, known.high])
        for (let i = first; i < (values?.length ?? 0); i += 1) {
          const value = /** @type {Float32Array} */ (values)[i];
          if (value === value && (layer.kind === "steps" || known.t[i] >= this.range.start) && known.t[i] <= this.range.end)
            scale.values.push(value * quantity.scale);
        }
      for (const value of known.outliers?.v ?? []) scale.values.push(value * quantity.scale);
    }
    const span = this.range.end - this.range.start;
    if (Math.abs(span / this.span - 1) > 0.01) this.axes.clear();
    this.span = span;
    for (const [name, { values, zero }] of found) {
      const sorted = Float64Array.from(values).sort();
      const [low, high] = axisRange(sorted[0], sorted[Math.floor(CLIP * (sorted.length - 1))], zero);
      const before = this.axes.get(name);
      const fits = before && before[0] <= low && high <= before[1] && high - low > SHRINK * (before[1] - before[0]);
      if (!fits) this.axes.set(name, [low, high]);
    }
  }

  /** @param {Seen} seen @param {Range} range @param {number | null} playhead */
  draw(seen, range, playhead) {
    [this.seen, this.range, this.playhead] = [seen, range, playhead];
    this.fit();
    this.plot?.setData(this.data());
    for (const { layer, entry, name } of this.legend ?? []) {
      const known = this.layer(layer);
      entry.hidden = !known?.t.length;
      const label = layer.label === this.choice.title ? "mean" : layer.label;
      const band = layer.kind === "band" && known?.high ? `, ${seen.view?.band.replace("-", "\u2013") ?? ""}` : "";
      name.textContent = `${label}${band}`;
    }
    this.point(/** @type {uPlot} */ (this.plot));
  }

  /** Draw what lies over the data. @param {uPlot} plot */
  mark(plot) {
    const { ctx, bbox } = plot;
    drawTimes(plot, (this.seen.commands?.list ?? []).map((each) => each.time), colourOf("command", 0.75), [3, 3]);
    if (this.playhead !== null) drawTimes(plot, [this.playhead], colourOf("accent"));
    ctx.save();
    for (const layer of this.choice.layers) {
      const known = this.layer(layer);
      const { scale, unit } = quantityOf(layer.quantity);
      const top = plot.scales[unit || "y"]?.max ?? Infinity;
      let above = 0;
      /** @param {ArrayLike<number>} times @param {ArrayLike<number>} values @param {boolean} dots */
      const put = (times, values, dots) => {
        for (let i = 0; i < times.length; i += 1) {
          const x = plot.valToPos(times[i], "x", true);
          if (!(x >= bbox.left && x <= bbox.left + bbox.width)) continue;
          const value = values[i] * scale;
          ctx.beginPath();
          if (value > top) {
            above += 1;
            ctx.moveTo(x - 3 * uPlot.pxRatio, bbox.top + 4 * uPlot.pxRatio);
            ctx.lineTo(x, bbox.top - uPlot.pxRatio);
            ctx.lineTo(x + 3 * uPlot.pxRatio, bbox.top + 4 * uPlot.pxRatio);
          } else if (dots) ctx.arc(x, plot.valToPos(value, unit || "y", true), 1.3 * uPlot.pxRatio, 0, 7);
          ctx.fill();
        }
      };
      ctx.fillStyle = colourOf(this.colour(layer), 0.8);
      if (known?.outliers) put(known.outliers.t, known.outliers.v, true);
      if (known) put(known.t, known.high ?? known.mean, false);
      const more = known?.outliers?.more ?? 0;
      const text = [above ? `${above} above` : "", more ? `${more} outliers not drawn` : ""].filter(Boolean).join(", ");
      if (text) {
        ctx.font = `${10 * uPlot.pxRatio}px system-ui, sans-serif`;
        ctx.textAlign = "right";
        ctx.textBaseline = "top";
        ctx.fillText(text, bbox.left + bbox.width - 4 * uPlot.pxRatio, bbox.top + 6 * uPlot.pxRatio);
      }
    }
    ctx.restore();
  }

  /** Write the values at the cursor, else at the playhead, into the legend. @param {uPlot} plot */
  point(plot) {
    const left = plot?.cursor.left ?? -1;
    const time = left >= 0 ? plot.posToVal(left, "x") : this.playhead;
    if (plot?.cursor.event) this.listener.onCursor(left >= 0 ? time : null);
    for (const { layer, value } of this.legend ?? []) {
      const known = this.layer(layer);
      let text = "";
      if (known && time !== null) {
        const before = placeOf(known.t, time);
        const next = before + 1 < known.t.length && known.t[before + 1] - time < time - known.t[before];
        const place = layer.kind !== "steps" && (next || before < 0) ? before + 1 : before;
        if (place >= 0) text = valueText(layer.quantity, known.mean[place]);
      }
      if (value.textContent !== text) value.textContent = text;
    }
  }
}

/** The column of plots; the one of the latest motion stands among them and is drawn elsewhere. */
export class PlotColumn {
  /**
   * @param {HTMLElement} host
   * @param {HTMLElement} motion figure of the plot with the id "motion"
   * @param {Listener} listener
   * @param {() => void} onChoice
   */
  constructor(host, motion, listener, onChoice) {
    this.host = host;
    this.motion = motion;
    this.listener = listener;
    this.onChoice = onChoice;
    /** @type {TimePlot[]} */
    this.plots = [];
    /** @type {Record<string, string>} */
    this.choices = {};
  }

  /** @param {import("./frames.js").PlotDefinition[]} definitions */
  define(definitions) {
    for (const plot of this.plots) plot.plot?.destroy();
    this.plots = [];
    this.host.replaceChildren();
    definitions.forEach((definition, number) => {
      if (definition.id === "motion") {
        this.host.append(this.motion);
        return;
      }
      const next = definitions[number + 1];
      const labelled = !next || next.id === "motion";
      const plot = new TimePlot(definition, labelled, this.listener, (id, choice) => {
        this.choices[id] = choice;
        this.onChoice();
      });
      this.host.append(plot.figure);
      this.plots.push(plot);
    });
  }

  /** Width of the area of data, in which a source answers [px]. */
  get width() {
    return Math.max(100, (this.plots[0]?.area.clientWidth ?? 800) - AXIS - END);
  }

  /** @param {Seen} seen @param {Range} range @param {number | null} playhead */
  draw(seen, range, playhead) {
    for (const plot of this.plots) plot.draw(seen, range, playhead);
  }
}

/** Return words about a time: commands and faults there.
 * @param {Seen} seen @param {number} time @param {number} span of the view [s] */
export function wordsAt(seen, time, span) {
  const near = (seen.commands?.list ?? []).filter((each) => Math.abs(each.time - time) < 0.006 * span);
  const faults = (seen.faults ?? []).filter((each) => each.onset <= time && time <= (each.end ?? Infinity));
  const parts = [...near.slice(-3).map((each) => each.text), ...faults.map((each) => inWords(each.kind))];
  return [timeText(time, span), ...parts].join(" \u00b7 ");
}
