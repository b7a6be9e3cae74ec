// @ts-check
/* Frames: what the page shows next, as a header in JSON and arrays in binary. */

/** Times are seconds of the run, values are in SI units; a field that is absent is as it was.
 * @typedef {{t: Float64Array, v: Float32Array}} Steps
 * @typedef {ArrayLike<number>} Values
 * @typedef {{t: Values, mean: Values, low?: Values, high?: Values, count?: Values, band?: string,
 *   outliers?: Steps & {more: number}, holes?: [number, number][], garbage?: {t: Values, count: number}}} Layer
 * @typedef {{start: number, end: number, detail: "overview" | "messages" | "waveform",
 *   band: string, layers: Record<string, Layer>}} View
 * @typedef {{quantity: string, label: string, kind: "band" | "line" | "steps", colour?: string}} PlotLayer
 * @typedef {{id: string, title: string, layers: PlotLayer[]}} Choice
 * @typedef {{id: string, title: string, choices: Choice[]}} PlotDefinition
 * @typedef {{number: number, kind: string, channel: string, magnitude: number | null, size: string, onset: number,
 *   end: number | null, active: boolean}} Fault
 * @typedef {{says: string, channels: string[], meaning: string, sizes: Record<string, [string, number]>}} FaultForm
 * @typedef {{time: number, kind: string, text: string}} Entry
 * @typedef {{time: number, period: number, nodal_plane: Float32Array, actuator: Float32Array, free_mass: Float32Array,
 *   drill_tool: Float32Array, contact_force: Float32Array, impacts: [number, number, number][]}} Section
 * @typedef {{mean: number | null, least: number | null, greatest: number | null, spark: Float32Array | number[], lost?: boolean, garbage?: number}} NumberOf
 * @typedef {{number: number, name: string, asker: string, state: "done" | "refused" | "failed", text: string}} Outcome
 * @typedef {{name: string, label: string, unit: string, scale: number, colour: string, floor: number, zero: boolean, credible: number}} Quantity
 * @typedef {{title: string, columns: string[], rows: (string | number | null)[][]}} Table @typedef {{verdict?: string, requirements?: string[], seed?: number | string, test?: string, tables: Table[]}} Report
 * @typedef {{
 *   number: number, mode?: "live" | "recorded" | "frozen", quantities?: Quantity[],
 *   plots?: PlotDefinition[], drills?: string[], drill?: string, run?: number, now?: number, at?: number, silent?: number, stepping?: [] | [number, number], moves?: boolean, begin?: number,
 *   extent?: [number, number], read?: number, connection?: {state: "searching" | "connected" | "vanished", since: number, reason: string},
 *   notice?: string, status?: Record<string, any>, values?: Record<string, Record<string, any>>,
 *   numbers?: Record<string, NumberOf | null>, faults?: Fault[], steps?: Record<string, Steps>,
 *   gaps?: [number, number][], view?: View, section?: Section, moments?: {time: number, frame: Partial<Frame>}[], kept?: number,
 *   timeline?: {t: Float64Array, low: Float32Array, mean: Float32Array, high: Float32Array, of: string},
 *   hole?: any, kinds?: Record<string, FaultForm>, outcomes?: Outcome[],
 *   units?: Record<string, Record<string, string>>, parameters?: string[][],
 *   refused?: [number, string], timing?: Record<string, string>, losses?: Record<string, number>, log?: Entry[], log_thinned?: number,
 *   jump?: {time?: number, peak_force?: number, contact_duration?: number, none?: string}, report?: Report, error?: string,
 * }} Frame
 */

/** Return the frame of a message; its arrays are views of the same bytes. @param {ArrayBuffer} buffer @returns {Frame} */
export function decode(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const begin = Math.ceil((4 + length) / 8) * 8;
  return JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)), (_, value) => {
    if (!Array.isArray(value?.$)) return value;
    const [offset, count, kind] = value.$;
    return new (kind === "f8" ? Float64Array : Float32Array)(buffer, begin + offset, count);
  });
}
