// @ts-check
/* Source of a frozen screen: answers requests from frames that the file holds. */
import { elements } from "./dom.js";
import { decode } from "./frames.js";
import { placeOf } from "./plots.js";

/** @typedef {import("./frames.js").Frame} Frame */

/** Frame in the file, as base64: the overview, and what the screen shows at some moments. */
export class FrozenSource {
  /** @param {(frame: Frame) => void} onFrame @param {(open: boolean, reason: string) => void} onState */
  constructor(onFrame, onState) {
    this.onFrame = onFrame;
    /** @type {Frame} */ this.held = { number: 0 };
    for (const script of elements("script.frame"))
      Object.assign(this.held, decode(Uint8Array.from(atob(script.textContent ?? ""), (letter) => letter.charCodeAt(0)).buffer));
    this.moments = this.held.moments ?? [];
    this.shown = this.playhead = NaN; // time of the moment that is shown, and that was asked for
    this.number = 0;
    queueMicrotask(() => (this.answer({ ...this.held, moments: undefined, view: undefined, mode: "frozen", begin: this.moments[0]?.time }), onState(true, "")));
  }

  /** @param {Partial<Frame>} frame */
  answer(frame) {
    this.number += 1;
    this.onFrame({ ...frame, number: this.number });
  }

  /** @param {Record<string, any>} request */
  send(request) {
    if (request.view && this.held.view) {
      const { start, end, width } = request.view;
      const layers = Object.entries(this.held.view.layers).map(([name, layer]) => [name, partOf({ band: this.held.view?.band, ...layer }, start, end, 0.5 * width)]);
      this.answer({ view: { ...this.held.view, start, end, layers: Object.fromEntries(layers) } });
    } else if (request.playhead !== undefined || request.section) {
      this.playhead = request.playhead ?? this.playhead;
      const away = (/** @type {{time: number}} */ { time }) => Math.abs(time - this.playhead);
      const near = this.moments.reduce((best, each) => (away(each) < away(best) ? each : best), this.moments[0]);
      if (!near || near.time === this.shown) return;
      this.shown = near.time;
      this.answer({ ...near.frame, kept: this.moments.length });
    } else if (request.seek) {
      const sections = this.moments.flatMap(({ frame: { section } }) => section ?? []);
      const impacts = sections.flatMap((each) => each.impacts.map(([after, peak, contact]) => ({ time: each.time + after, peak_force: peak, contact_duration: contact })));
      const ahead = request.seek === "next";
      const found = impacts.filter(({ time }) => (ahead ? time > request.from + 1e-9 : time < request.from - 1e-9));
      this.answer({ jump: found.at(ahead ? 0 : -1) ?? { none: "there is no further impact in this report" } });
    }
  }
}

/** Return a layer between two times, in about so many bins: several become one. Means are weighted by the counts of values;
 * quantiles of several bins cannot be had from theirs, and the band says that it is the widest of them.
 * @param {import("./frames.js").Layer} layer @param {number} start @param {number} end @param {number} width
 * @returns {import("./frames.js").Layer} */
function partOf(layer, start, end, width) {
  const first = Math.max(0, placeOf(layer.t, start));
  const last = Math.min(layer.t.length, placeOf(layer.t, end) + 2);
  const joined = Math.max(1, Math.floor((last - first) / Math.max(1, width)));
  const merge = (/** @type {import("./frames.js").Values} */ values, /** @type {(values: number[], begin: number) => number} */ join) =>
    Array.from({ length: Math.max(0, Math.ceil((last - first) / joined)) }, (_, i) => {
      const begin = first + i * joined, part = Array.from({ length: Math.min(last - begin, joined) }, (_, at) => values[begin + at]);
      return part.some(Number.isNaN) ? NaN : join(part, begin); // a gap stays one
    });
  const { t, mean, low, high, count, outliers, band, ...rest } = layer;
  const sumOf = (/** @type {number[]} */ values) => values.reduce((sum, value) => sum + value, 0);
  const meanOf = (/** @type {number[]} */ values, /** @type {number} */ begin) => {
    const weights = values.map((_, at) => count?.[begin + at] || 1);
    return sumOf(values.map((value, at) => value * weights[at])) / sumOf(weights);
  };
  const [from, to] = [placeOf(outliers?.t ?? [], start) + 1, placeOf(outliers?.t ?? [], end) + 1];
  return {
    ...rest,
    band: joined > 1 && band?.includes("%") ? `widest ${band}` : band,
    t: merge(t, (values) => sumOf(values) / values.length),
    mean: merge(mean, meanOf),
    low: low && merge(low, (values) => Math.min(...values)),
    high: high && merge(high, (values) => Math.max(...values)),
    outliers: outliers && { t: outliers.t.subarray(from, to), v: outliers.v.subarray(from, to), more: outliers.more },
  };
}
