// @ts-check
/* The whole run in one strip: envelope, faults, commands, gaps, the view and the playhead. */
import { commandsOf, drawSpans, drawTimes, keepSize, placesOf, sharedCursor, sizeOf, timeAxis } from "./marks.js";
import { columnOf } from "./plots.js";
import { element } from "./dom.js";
import { axisRange, clippedEnds, colourOf, numberText, quantityOf } from "./quantities.js";

/** Strip below the screen; a drag shows that part, a click goes there. */
export class Timeline {
  /** @param {HTMLElement} host @param {import("./marks.js").Listener} listener */
  constructor(host, listener) {
    /** @type {import("./marks.js").Seen} */ this.seen = {};
    /** @type {import("./marks.js").Range} */ this.range = { start: 0, end: 1 };
    /** @type {number | null} */ this.playhead = null;
    /** @type {[number, number]} */ this.ends = [0, 1]; // of the axis of values
    const { hooks, ...shared } = sharedCursor(listener);
    const edge = { stroke: "transparent", width: 0, points: { show: false } };
    /** @type {uPlot.Options} */
    const options = {
      ...sizeOf(host), ...shared,
      series: [{}, { stroke: () => colourOf("force"), width: 1, points: { show: false } }, edge, { ...edge }],
      bands: [{ series: [3, 2], fill: () => colourOf("force", 0.25) }],
      scales: { x: { time: false, range: () => this.whole() }, y: { range: () => this.ends } },
      axes: [timeAxis(true), { show: false }],
      padding: [2, 14, 0, 14],
      hooks: { ...hooks, drawClear: [(plot) => drawSpans(plot, this.seen)], draw: [(plot) => this.mark(plot)] },
    };
    this.plot = new uPlot(options, [[], [], [], []], host);
    keepSize(this.plot, host);
  }

  /** @returns {[number, number]} ends of the run */
  whole() {
    const [first, last] = this.seen.extent ?? [0, 1];
    return [first, Math.max(last, first + 1e-6)];
  }

  /** @param {import("./marks.js").Seen} seen @param {import("./marks.js").Range} range @param {number | null} playhead */
  draw(seen, range, playhead) {
    [this.seen, this.range, this.playhead] = [seen, range, playhead];
    const { t = [], mean = [], low = [], high = [], of = "" } = seen.timeline ?? {}, { label, unit, scale, credible } = quantityOf(of);
    this.ends = axisRange(...clippedEnds([mean, low, high].flatMap((values) => Array.from(values)), credible), true);
    element("strip-of").textContent = of && `${label}, ${numberText(this.ends[0] * scale)} to ${numberText(this.ends[1] * scale)} ${unit}`;
    this.plot.setData([Array.from(t), ...[mean, low, high].map((values) => columnOf(values, t.length, 1, this.ends))]);
  }

  /** Fade what is out of view, and mark commands at the lower edge. @param {uPlot} plot */
  mark(plot) {
    const { ctx, bbox } = plot;
    const ratio = uPlot.pxRatio;
    ctx.save();
    const place = placesOf(plot);
    for (const { time, kind } of commandsOf(this.seen)) {
      ctx.fillStyle = colourOf(kind === "failure" ? "fault" : "command");
      ctx.fillRect(place(time) - ratio / 2, bbox.top + bbox.height - 8 * ratio, ratio * 1.5, 8 * ratio);
    }
    const [from, to] = [place(this.range.start), place(this.range.end)];
    ctx.fillStyle = colourOf("paper", 0.62);
    ctx.fillRect(bbox.left, bbox.top, from - bbox.left, bbox.height);
    ctx.fillRect(to, bbox.top, bbox.left + bbox.width - to, bbox.height);
    ctx.strokeStyle = colourOf("muted");
    ctx.lineWidth = ratio;
    ctx.strokeRect(Math.round(from) + 0.5, bbox.top + 0.5, Math.max(Math.round(to - from) - 1, 2), bbox.height - 1);
    ctx.restore();
    if (this.playhead !== null) drawTimes(plot, [this.playhead], colourOf("accent"));
  }
}
