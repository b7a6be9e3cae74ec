// @ts-check
/* What few readers need at once: timing and losses, all values, the log, and tables of a report. */
import { inWords, numberText } from "./quantities.js";

/** @typedef {(string | number | null | undefined)[]} Row */

/** Return a table; a reader can scroll it sideways.
 * @param {string} title @param {string[]} columns @param {Row[]} rows */
function tableOf(title, columns, rows) {
  const [frame, table, caption] = [document.createElement("div"), document.createElement("table"), document.createElement("caption")];
  frame.className = "wide";
  frame.tabIndex = 0;
  frame.role = "region";
  frame.ariaLabel = title;
  caption.textContent = title;
  table.append(caption);
  if (columns.length) {
    const head = table.createTHead().insertRow();
    for (const column of columns) head.append(Object.assign(document.createElement("th"), { scope: "col", textContent: column }));
  }
  const body = table.createTBody();
  for (const values of rows) {
    const row = body.insertRow();
    for (const value of values)
      row.insertCell().textContent = typeof value === "number" ? numberText(value) : value ?? "\u2013";
  }
  frame.append(table);
  return frame;
}

/** Folded parts below the timeline; one is filled while it is open. */
export class Details {
  /** @param {HTMLElement} host @param {HTMLElement} report */
  constructor(host, report) {
    this.report = report;
    /** @type {import("./marks.js").Seen} */
    this.seen = {};
    this.parts = [
      this.part(host, "timing and losses", () => this.timing()),
      this.part(host, "all values", () => this.values()),
      this.part(host, "log of commands", () => this.log()),
      this.part(host, "values by segment", () => (this.seen.report?.tables ?? []).map((each) => tableOf(each.title, each.columns, each.rows))),
    ];
  }

  /** @param {HTMLElement} host @param {string} title @param {() => (Node | string)[]} fill */
  part(host, title, fill) {
    const [details, summary, content] = [document.createElement("details"), document.createElement("summary"), document.createElement("div")];
    summary.textContent = title;
    details.append(summary, content);
    host.append(details);
    const draw = () => {
      if (details.open) content.replaceChildren(...fill());
    };
    details.ontoggle = draw;
    return { details, draw };
  }

  /** @param {import("./marks.js").Seen} seen @param {Partial<import("./frames.js").Frame>} frame */
  draw(seen, frame) {
    this.seen = seen;
    const [timing, values, log, segments] = this.parts;
    if (frame.timing || frame.losses || frame.refusals) timing.draw();
    if (frame.values || frame.status) values.draw();
    if (frame.log || frame.outcomes) log.draw();
    segments.details.hidden = !seen.report?.tables.length;
    if (frame.report) {
      segments.draw();
      this.verdict(frame.report);
    }
  }

  timing() {
    const { timing = {}, losses = {}, refusals } = this.seen;
    const lost = Object.entries(losses).filter(([, count]) => count);
    const rows = [...Object.entries(timing), ["messages lost on the way here", lost.length ? lost.map(([topic, count]) => `${topic} ${count}`).join(", ") : "0"]];
    if (refusals) rows.push(["commands refused", `${refusals[0]}${refusals[1] ? `, the latest: ${refusals[1]}` : ""}`]);
    return [tableOf("timing and losses", [], rows)];
  }

  values() {
    const topics = { status: this.seen.status ?? {}, ...this.seen.values };
    return Object.entries(topics).filter(([, fields]) => Object.keys(fields).length)
      .map(([topic, fields]) => tableOf(topic, [], Object.entries(fields).map(([name, value]) => [inWords(name), typeof value === "boolean" ? (value ? "yes" : "no") : value])));
  }

  log() {
    const { log = [], log_thinned: thinned = 0 } = this.seen;
    const rows = [...log].reverse().map((entry) => [`${entry.time.toFixed(3)} s`, entry.kind, entry.text]);
    return [...(thinned ? [`${thinned} entries are left out, evenly.`] : []), tableOf("log of commands, the newest first", ["time", "kind", "what"], rows)];
  }

  /** Show what a test says of its run, before the screen. @param {import("./frames.js").Report} report */
  verdict(report) {
    const { verdict, requirements = [], seed, test } = report;
    this.report.hidden = !verdict;
    if (!verdict) return;
    const [title, list] = [document.createElement("h2"), document.createElement("ul")];
    title.textContent = [verdict, test].filter(Boolean).join(" \u00b7 ");
    title.dataset.verdict = verdict;
    list.append(...requirements.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
    this.report.replaceChildren(title, list, ...(seed === undefined ? [] : [`seed ${seed}`]));
  }
}
