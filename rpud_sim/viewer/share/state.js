// @ts-check
/* What the drill does, in one word with its reason: the state bar and the title of the tab. */
import { inWords, quantityOf, valueText } from "./quantities.js";

const STILL = 1e-8; // a bit that is slower makes no progress [m/s]

/** @typedef {import("./marks.js").Seen} Seen @typedef {import("./frames.js").Fault} Fault */

/** Return the faults that are active at the time that is shown. @param {Seen} seen @returns {Fault[]} */
export function activeFaults({ faults = [], at = Infinity }) { return faults.filter(({ onset, end }) => onset <= at && (end === null || at < end)); }

/** Return whether the bit is in the rock: an arm measures it, else the regime says it. @param {Seen} seen */
export function inContact({ status = {}, values = {} }) {
  const touches = values.mount?.in_contact; // of a bag, a mean of some samples
  return (touches ?? null) === null ? status.regime !== "free" : touches >= 0.5;
}

/** Return word, reason and tone. @param {Seen} seen @param {string} lost why nothing is known of the drill now
 * @returns {[string, string, "good" | "bad" | "warning" | ""]} */
export function stateOf(seen, lost) {
  const { status = {}, stepping: [passed = 0, whole = 0] = [], numbers = {}, parameters = [] } = seen, rate = status.penetration_rate;
  const lacks = Object.keys(numbers).filter((name) => numbers[name]?.lost).map((name) => quantityOf(name).label);
  if (lost) return ["not connected", "", "bad"];
  if (whole) return ["stepping", `${Math.floor(passed)} of ${whole} s`, ""];
  if (status.state !== "running") return [status.state ?? "", "", ""];
  const [, timeout = "command_timeout"] = parameters.find(([name]) => name === "command_timeout") ?? [];
  if (status.commands_lost) return ["commands lost", `none came for ${timeout}: drive and weight on bit are ramped to zero`, "bad"];
  const jam = activeFaults(seen).find(({ kind }) => kind === "free_mass_jammed");
  if (jam) return ["jammed", `${inWords(jam.kind)} since ${jam.onset.toFixed(2)} s`, "bad"];
  if (status.drive_enabled === false) return ["off", "the drive is off", ""];
  if (lacks.length) return ["messages lost", lacks.join(", "), "warning"];
  if (!inContact(seen)) return ["no contact", "the bit is not in the rock", "warning"];
  if (Number.isFinite(rate) && rate < STILL) return ["no progress", numbers.impact_rate?.mean === 0 ? "no impacts" : valueText("penetration_rate", rate, true, true), "warning"];
  return ["drilling", Number.isFinite(rate) ? valueText("penetration_rate", rate, true, true) : "", "good"];
}
