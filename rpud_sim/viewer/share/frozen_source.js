// @ts-check
/* Source of a frozen screen: answers requests from frames that the file holds. */
import { elements } from "./dom.js";
import { decode } from "./frames.js";
import { placeOf } from "./plots.js";

/** @typedef {import("./frames.js").Frame} Frame */

/** Frames in the file, as base64; the first has everything: the overview, and some blocks of motion. */
export class FrozenSource {
  /** @param {(frame: Frame) => void} onFrame @param {(open: boolean, reason: string) => void} onState */
  constructor(onFrame, onState) {
    this.onFrame = onFrame;
    /** @type {Frame} */ this.held = { number: 0 };
    for (const script of elements("script.frame"))
      Object.assign(this.held, decode(Uint8Array.from(atob(script.textContent ?? ""), (letter) => letter.charCodeAt(0)).buffer));
    this.number = 0;
    queueMicrotask(() => (this.answer({ ...this.held, sections: undefined, section: undefined, view: undefined, mode: "frozen" }), onState(true, "")));
  }

  /** @param {Partial<Frame>} frame */
  answer(frame) {
    this.number += 1;
    this.onFrame({ ...frame, number: this.number });
  }

  /** @param {Record<string, any>} request */
  send(request) {
    const sections = this.held.sections ?? [];
    if (request.view && this.held.view) {
      const { start, end, width } = request.view;
      const layers = Object.entries(this.held.view.layers).map(([name, layer]) => [name, partOf(layer, start, end, 0.5 * width)]);
      this.answer({ view: { ...this.held.view, start, end, layers: Object.fromEntries(layers) } });
    } else if (request.playhead !== undefined || request.section) {
      this.playhead = request.playhead ?? this.playhead ?? this.held.extent?.[0] ?? 0;
      const near = sections.reduce((best, each) => (away(each, this.playhead) < away(best, this.playhead) ? each : best), sections[0]);
      const fresh = near && near !== this.shown ? { section: { ...near, kept: sections.map((each) => each.time) } } : null;
      this.shown = near;
      if (fresh || !request.section) this.answer({ numbers: this.numbers(this.playhead), hole: this.hole(this.playhead), ...fresh });
    } else if (request.seek) {
      const impacts = sections.flatMap((each) => each.impacts.map(([after, peak, contact]) => ({ time: each.time + after, peak_force: peak, contact_duration: contact })));
      const ahead = request.seek === "next";
      const found = impacts.filter(({ time }) => (ahead ? time > request.from + 1e-9 : time < request.from - 1e-9));
      this.answer({ jump: found.at(ahead ? 0 : -1) ?? { none: "there is no further impact in this report" } });
    }
  }

  /** @param {number} time @returns {Frame["hole"]} as deep as it was at a time, with the log of what was drilled by then */
  hole(time) {
    const { t, mean } = this.held.view?.layers.depth ?? { t: [], mean: [] }, { hole } = this.held, place = placeOf(t, time);
    if (!hole || place < 0 || !(mean[place] < hole.depth)) return hole;
    const depth = mean[place], drilled = placeOf(hole.log.depth, depth) + 1;
    return { ...hole, depth, log: Object.fromEntries(Object.entries(hole.log).map(([name, values]) => [name, values.subarray(0, drilled)])) };
  }

  /** @param {number} time @returns {Frame["numbers"]} of the second before a time, by the overview */
  numbers(time) {
    return Object.fromEntries(Object.entries(this.held.numbers ?? {}).map(([name, held]) => {
      const { layers = {} } = this.held.view ?? {};
      const whole = name === "power" ? layers.electrical_power ?? layers.actuator_power : layers[name];
      if (!whole || !held) return [name, held];
      // A rate needs enough impacts: its extremes are those of tenths of the second, as elsewhere.
      const layer = name === "impact_rate" ? partOf(whole, time - 1, time, 10) : whole;
      const end = placeOf(layer.t, time) + 1;
      const first = Math.max(0, Math.min(placeOf(layer.t, time - 1) + 1, end - 1));
      const of = (/** @type {import("./frames.js").Values} */ values) => Array.from(values).slice(first, end).filter(Number.isFinite);
      const mean = of(layer.mean);
      const spark = Array.from(partOf(whole, time - 60, time, 60).mean).filter(Number.isFinite);
      if (!mean.length) return [name, { mean: null, least: null, greatest: null, spark }];
      const [least, greatest] = [Math.min(...of(layer.low ?? layer.mean)), Math.max(...of(layer.high ?? layer.mean))];
      return [name, { mean: meanOf(mean), least, greatest, spark }];
    }));
  }
}

/** @param {import("./frames.js").Section} section @param {number} time how far it is from its end [s] */
function away(section, time) {
  return Math.abs(section.time + section.period * section.free_mass.length - time);
}

/** @param {number[]} values */
function meanOf(values) {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

/** Return a layer between two times, in about so many bins: several become one.
 * @param {import("./frames.js").Layer} layer @param {number} start @param {number} end @param {number} width
 * @returns {import("./frames.js").Layer} */
function partOf(layer, start, end, width) {
  const first = Math.max(0, placeOf(layer.t, start));
  const last = Math.min(layer.t.length, placeOf(layer.t, end) + 2);
  const joined = Math.max(1, Math.floor((last - first) / Math.max(1, width)));
  const merge = (/** @type {import("./frames.js").Values} */ values, /** @type {(values: number[]) => number} */ join) =>
    Array.from({ length: Math.max(0, Math.ceil((last - first) / joined)) }, (_, i) => {
      const begin = first + i * joined, part = Array.from({ length: Math.min(last - begin, joined) }, (_, at) => values[begin + at]);
      return part.some(Number.isNaN) ? NaN : join(part); // a gap stays one
    });
  const { t, mean, low, high, outliers, ...rest } = layer;
  const [from, to] = [placeOf(outliers?.t ?? [], start) + 1, placeOf(outliers?.t ?? [], end) + 1];
  return {
    ...rest,
    t: merge(t, meanOf),
    mean: merge(mean, meanOf),
    low: low && merge(low, (values) => Math.min(...values)),
    high: high && merge(high, (values) => Math.max(...values)),
    outliers: outliers && { t: outliers.t.subarray(from, to), v: outliers.v.subarray(from, to), more: outliers.more },
  };
}
