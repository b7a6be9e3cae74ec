// @ts-check
/* What all plots over time share: the axis, the cursor, and marks of faults, gaps, commands and the playhead. */
import { LONG, clockText, colourOf, inWords, timeText } from "./quantities.js";

/**
 * @typedef {Partial<import("./frames.js").Frame> & {mark?: number | null, motion?: [number, number]}} Seen what all
 *   frames of a run have said, the second cursor, and the time of the motion that is shown
 * @typedef {{start: number, end: number}} Range
 * @typedef {{zoom: (start: number, end: number) => void, look: (zoomed: Range | null) => void,
 *   point: (time: number | null) => void, click: (time: number) => void}} Listener hands of the reader
 */

export const AXIS = 52; // width of every axis of values, as --axis [px]
export const END = 10; // free on the right, as --end [px]

const LONG_RUN = 600; // s; from here on axes have hours and minutes
const MINUTES = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 43200, 86400, 604800]; // steps of these [s]
const STEPS = Array.from({ length: 60 }, (_, i) => [1, 2, 5].map((each) => Number(`${each}e${i - 15}`))).flat();

/** Return an axis with a thin grid. @param {uPlot.Axis} options @returns {uPlot.Axis} */
export function axisOf(options) {
  return {
    stroke: () => colourOf("muted"), font: "12px system-ui, sans-serif", incrs: STEPS, ticks: { show: false },
    grid: { stroke: () => colourOf("rule"), width: 1 },
    values: (_, values, __, ___, step) => tickTexts(values, step),
    ...options,
  };
}

/** @param {HTMLElement} host of a plot */
export function sizeOf(host) { return { width: host.clientWidth || 300, height: host.clientHeight || 120 }; }

/** Let a plot fill its host, whose size may change. @param {uPlot} plot @param {HTMLElement} host @param {() => void} [then] */
export function keepSize(plot, host, then) { new ResizeObserver(() => (plot.setSize(sizeOf(host)), then?.())).observe(host); }

/** @param {(number | null)[]} values of an axis, null for none @param {number} step between them @returns {string[]} */
function tickTexts(values, step) {
  const places = Math.max(0, Math.min(9, -Math.floor(Math.log10(step) + 1e-9)));
  const most = Math.max(...values.map((value) => Math.abs(value ?? 0))), plain = most < LONG && (most >= 1e-3 || !most);
  const text = (/** @type {number} */ value) => (plain || !value ? value.toFixed(plain ? places : 0) : value.toExponential(1));
  return values.map((value) => (value === null ? "" : text(value).replace("-", "\u2212")));
}

/** @param {number[]} times of an axis [s] @param {number} step between them @returns {string[]} with their units */
function timeTexts(times, step) {
  if (step >= 1 && times[times.length - 1] >= LONG_RUN) return times.map((time) => clockText(time, 0, true));
  if (step >= 0.01) return tickTexts(times, step).map((text) => `${text} s`);
  const whole = Math.floor(times[0] ?? 0), texts = tickTexts(times.map((time) => 1e3 * (time - whole)), 1e3 * step);
  return texts.map((text, place) => (whole ? `${place ? "" : `${whole} s `}+${text} ms` : `${text} ms`));
}

/** Return the time axis of a plot, whose times may be written below another one.
 * @param {boolean} written @returns {uPlot.Axis} */
export function timeAxis(written) {
  return axisOf({
    size: written ? 18 : 0, gap: 4, space: 90,
    incrs: (plot) => (Number(plot.scales.x.max) >= LONG_RUN ? [...STEPS.filter((each) => each < 1), ...MINUTES] : STEPS),
    values: (plot, values, _, __, step) => {
      const [before, edge] = [-plot.bbox.left, plot.bbox.width].map((each) => each / uPlot.pxRatio);
      const fits = (/** @type {number} */ x, /** @type {number} */ half) => x - half > before && x + half < edge + 8; // others would be cut
      return timeTexts(values, step).map((text, i) => (written && fits(plot.valToPos(values[i], "x"), 3.5 * text.length) ? text : ""));
    },
  });
}

/** Return options of a plot whose cursor is also that of the others, and where a drag zooms.
 * @param {Listener} listener @returns {{legend: uPlot.Legend, cursor: uPlot.Cursor, hooks: Partial<uPlot.Hooks.Arrays>}} */
export function sharedCursor(listener) {
  let dragged = false;
  /** @type {uPlot.Cursor} */
  const cursor = {
    y: false, points: { show: false }, drag: { setScale: false, x: true, y: false, dist: 4 },
    sync: { key: "time", scales: ["x", null], filters: { pub: (kind) => kind === "mousemove" || kind === "mouseleave" } },
    bind: {
      dblclick: () => () => (listener.look(null), null),
      mousedown: (_, __, handler) => (event) => (event.shiftKey ? null : handler(event)), // that moves the view
    },
  };
  return {
    legend: { show: false },
    cursor,
    hooks: {
      setSelect: [(plot) => {
        const { left, width } = plot.select;
        dragged = width > 4;
        if (dragged) listener.zoom(plot.posToVal(left, "x"), plot.posToVal(left + width, "x"));
        plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      }],
      ready: [(plot) => {
        plot.over.addEventListener("mousedown", () => (dragged = false));
        plot.over.addEventListener("click", (event) => dragged || event.shiftKey || listener.click(plot.posToVal(event.offsetX, "x")));
      }],
    },
  };
}

/** Return places of times in a plot, at most at its edges [px of the canvas]. @param {uPlot} plot @returns {(time: number) => number} */
export function placesOf({ bbox, scales: { x: { min = 0, max = 1 } } }) { return (time) => bbox.left + Math.max(0, Math.min(1, (time - min) / (max - min))) * bbox.width; }

/** Shade faults and the motion, and hatch where messages are missing, below the data.
 * @param {uPlot} plot @param {Seen} seen @param {[number, number][]} holes of the plot's own messages */
export function drawSpans(plot, seen, holes = []) {
  const { ctx, bbox } = plot;
  const place = placesOf(plot);
  for (const fault of seen.faults ?? []) {
    const [from, to] = [place(fault.onset), place(fault.end ?? seen.now ?? Infinity)];
    ctx.fillStyle = colourOf("fault", 0.07);
    ctx.fillRect(from, bbox.top, to - from, bbox.height);
    ctx.fillStyle = colourOf("fault", 0.7);
    if (from > bbox.left && from < bbox.left + bbox.width) ctx.fillRect(from, bbox.top, uPlot.pxRatio, bbox.height);
  }
  if (seen.motion) {
    ctx.fillStyle = colourOf("mass", 0.35);
    ctx.fillRect(place(seen.motion[0]), bbox.top, Math.max(place(seen.motion[1]) - place(seen.motion[0]), 2 * uPlot.pxRatio), bbox.height);
  }
  for (const [begin, end] of [...(seen.gaps ?? []), ...holes]) {
    const [from, to] = [place(begin), place(end)];
    ctx.save();
    ctx.beginPath();
    ctx.rect(from, bbox.top, to - from, bbox.height);
    ctx.clip();
    ctx.beginPath();
    for (let x = from - bbox.height; x < to; x += 7 * uPlot.pxRatio) {
      ctx.moveTo(x, bbox.top + bbox.height);
      ctx.lineTo(x + bbox.height, bbox.top);
    }
    ctx.strokeStyle = colourOf("gap", 0.35);
    ctx.lineWidth = uPlot.pxRatio;
    ctx.stroke();
    ctx.restore();
  }
}

/** Draw upright lines over the data. @param {uPlot} plot @param {number[]} times @param {string} colour @param {number[]} dash */
export function drawTimes({ ctx, bbox, scales: { x: { min = 0, max = 1 } } }, times, colour, dash = []) {
  ctx.save();
  ctx.beginPath();
  for (const time of times.filter((each) => each >= min && each <= max)) {
    const x = Math.round(bbox.left + ((time - min) / (max - min)) * bbox.width) + 0.5;
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
  }
  ctx.setLineDash(dash.map((length) => length * uPlot.pxRatio));
  ctx.strokeStyle = colour;
  ctx.lineWidth = uPlot.pxRatio;
  ctx.stroke();
  ctx.restore();
}

/** Write at the upper edge what began when, where there is room. @param {uPlot} plot @param {Seen} seen */
export function drawWords(plot, seen) {
  const { ctx, bbox } = plot;
  const faults = (seen.faults ?? []).map((fault) => ({ time: fault.onset, text: faultText(fault), colour: "fault" }));
  const words = [...faults, ...commandsOf(seen).map(({ time, text, kind }) => ({ time, text, colour: kind === "failure" ? "fault" : "command" }))];
  ctx.save();
  ctx.font = `${12 * uPlot.pxRatio}px system-ui, sans-serif`;
  [ctx.textAlign, ctx.textBaseline] = ["left", "top"];
  let free = bbox.left; // from here on
  for (const { time, text, colour } of words.sort((a, b) => a.time - b.time)) {
    const { width } = ctx.measureText(text), at = plot.valToPos(time, "x", true), gap = 4 * uPlot.pxRatio;
    const x = at + gap + width > bbox.left + bbox.width ? at - gap - width : at + gap, end = x + width;
    if (x < free || at > bbox.left + bbox.width) continue;
    ctx.fillStyle = colourOf(colour);
    ctx.fillText(text, x, bbox.top + 2 * uPlot.pxRatio);
    free = end;
  }
  ctx.restore();
}

/** @param {import("./frames.js").Fault} fault @returns {string} kind and channel */
const faultText = ({ kind, channel }) => inWords(channel ? `${kind} on ${channel}` : kind);

/** @param {Seen} seen @returns {import("./frames.js").Entry[]} commands, resets and failures of a test; faults are shaded */
export function commandsOf(seen) { return (seen.log ?? []).filter(({ kind, time }) => kind === "command" || kind === "failure" || (kind === "run" && time > 0)); }

/** Return a time in words, with the commands and faults there.
 * @param {Seen} seen @param {number} time @param {number} span of the view [s] */
export function wordsAt(seen, time, span) {
  const near = commandsOf(seen).filter((each) => Math.abs(each.time - time) < 0.006 * span);
  const faults = (seen.faults ?? []).filter((each) => each.onset <= time && time <= (each.end ?? Infinity));
  return [timeText(time, span), ...near.slice(-3).map((each) => each.text), ...faults.map(faultText)].join(" \u00b7 ");
}
