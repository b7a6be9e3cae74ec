// @ts-check
/* Source of a frozen screen: answers requests from frames that the file holds. */
import { decode } from "./frames.js";
import { placeOf } from "./plots.js";

/** @typedef {import("./frames.js").Frame} Frame */

/** The report of a bag, without a server: it has the overview, and some blocks of motion. */
export class FrozenSource {
  /**
   * @param {Iterable<HTMLScriptElement>} scripts with frames, in base64; the first has everything
   * @param {(frame: Frame) => void} onFrame
   * @param {(open: boolean, reason: string) => void} onState
   */
  constructor(scripts, onFrame, onState) {
    this.onFrame = onFrame;
    /** @type {Frame} */
    this.held = { number: 0 };
    for (const script of scripts)
      Object.assign(this.held, decode(Uint8Array.from(atob(script.textContent ?? ""), (letter) => letter.charCodeAt(0)).buffer));
    this.number = 0;
    queueMicrotask(() => {
      const { sections, ...frame } = this.held;
      this.answer({ ...frame, view: undefined, mode: "frozen" });
      onState(true, "");
    });
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
      const layers = Object.entries(this.held.view.layers).map(([name, layer]) => [name, part(layer, start, end, width)]);
      this.answer({ view: { ...this.held.view, start, end, layers: Object.fromEntries(layers) } });
    } else if (request.playhead !== undefined || request.section) {
      this.playhead = request.playhead ?? this.playhead ?? this.held.extent?.[0] ?? 0;
      const near = sections.reduce((best, each) => (away(each, this.playhead) < away(best, this.playhead) ? each : best), sections[0]);
      const numbers = this.numbers(this.playhead);
      this.answer(near && (request.section || near !== this.shown)
        ? { numbers, section: { ...near, kept: sections.map((each) => each.time) } } : { numbers });
      this.shown = near;
    } else if (request.seek) {
      const impacts = sections.flatMap((each) => each.impacts.map(([after, , contact]) => ({ time: each.time + after, contact })));
      const ahead = request.seek === "next";
      const found = impacts.filter(({ time }) => (ahead ? time > request.from + 1e-9 : time < request.from - 1e-9));
      this.answer({ jump: found.at(ahead ? 0 : -1) ?? { none: "there is no further impact in this report" } });
    }
  }

  /** @param {number} time @returns {Frame["numbers"]} of the second before a time, from the overview */
  numbers(time) {
    return Object.fromEntries(Object.entries(this.held.numbers ?? {}).map(([name, held]) => {
      const layer = this.held.view?.layers[name];
      if (!layer || !held) return [name, held];
      const last = placeOf(layer.t, time) + 1;
      const first = Math.min(placeOf(layer.t, time - 1) + 1, Math.max(last - 1, 0));
      const of = (/** @type {Float32Array} */ values) => values.subarray(first, last).filter((value) => value === value);
      const mean = of(layer.mean);
      const spark = layer.mean.subarray(Math.max(0, last - 60), last);
      if (!mean.length) return [name, { mean: null, least: null, greatest: null, spark }];
      const [least, greatest] = [Math.min(...of(layer.low ?? layer.mean)), Math.max(...of(layer.high ?? layer.mean))];
      return [name, { mean: mean.reduce((sum, value) => sum + value) / mean.length, least, greatest, spark }];
    }));
  }
}

/** @param {import("./frames.js").Section} section @param {number} time how far it is from its end [s] */
function away(section, time) {
  return Math.abs(section.time + section.period * section.free_mass.length - time);
}

/** Return a layer between two times, with about so many bins: several become one.
 * @param {import("./frames.js").Layer} layer @param {number} start @param {number} end @param {number} width
 * @returns {import("./frames.js").Layer} */
export function part(layer, start, end, width) {
  const first = Math.max(0, placeOf(layer.t, start));
  const last = Math.min(layer.t.length, placeOf(layer.t, end) + 2);
  const joined = Math.max(1, Math.floor((last - first) / Math.max(1, width)));
  const count = Math.max(0, Math.ceil((last - first) / joined));
  /** @template {Float32Array | Float64Array} T @param {T} values @param {(part: T) => number} join @param {T} into */
  const merge = (values, join, into) => {
    for (let i = 0; i < count; i += 1) {
      const from = first + i * joined;
      const known = values.subarray(from, Math.min(from + joined, last)).filter((value) => value === value);
      into[i] = known.length ? join(/** @type {T} */ (known)) : NaN;
    }
    return into;
  };
  const mean = (/** @type {Float32Array | Float64Array} */ values) => values.reduce((sum, value) => sum + value, 0) / values.length;
  /** @type {import("./frames.js").Layer} */
  const merged = { t: merge(layer.t, mean, new Float64Array(count)), mean: merge(layer.mean, mean, new Float32Array(count)) };
  if (layer.low) merged.low = merge(layer.low, (values) => Math.min(...values), new Float32Array(count));
  if (layer.high) merged.high = merge(layer.high, (values) => Math.max(...values), new Float32Array(count));
  if (layer.outliers) {
    const { t, v, more } = layer.outliers;
    const [from, to] = [placeOf(t, start) + 1, placeOf(t, end) + 1];
    merged.outliers = { t: t.subarray(from, to), v: v.subarray(from, to), more };
  }
  return merged;
}
