// @ts-check
/* What few readers need at once: timing and losses, all values, the log, and tables of a report. */
import { make } from "./dom.js";
import { inWords, numberText, siText } from "./quantities.js";

/** Return a table that a reader can scroll.
 * @param {string} title @param {string[]} columns @param {unknown[][]} rows */
function tableOf(title, columns, rows) {
  const cells = (/** @type {unknown[]} */ row) => row.map((value) => {
    if (typeof value === "boolean") return value ? "yes" : "no";
    return typeof value === "number" ? numberText(value) : String(value ?? "\u2013");
  });
  const head = make("tr", {}, ...columns.map((textContent) => make("th", { scope: "col", textContent })));
  const body = rows.map((row) => make("tr", {}, ...cells(row).map((textContent) => make("td", { textContent }))));
  const table = make("table", {}, make("caption", { textContent: title }), ...(columns.length ? [make("thead", {}, head)] : []), make("tbody", {}, ...body));
  return make("div", { className: "wide", tabIndex: 0, role: "region", ariaLabel: title }, table);
}

/** Folded parts below the timeline; one is filled while it is open. */
export class Details {
  /** @param {HTMLElement} host @param {HTMLElement} report */
  constructor(host, report) {
    this.report = report;
    /** @type {import("./marks.js").Seen} */ this.seen = {};
    const part = (/** @type {string} */ title, /** @type {() => (Node | string)[]} */ fill) => {
      const content = make("div");
      const details = make("details", {}, make("summary", { textContent: title }), content);
      const draw = () => details.open && content.replaceChildren(...fill());
      details.ontoggle = draw;
      host.append(details);
      addEventListener("beforeprint", () => { // all is printed, also what is folded
        if (details.open) return;
        details.open = true;
        draw();
        addEventListener("afterprint", () => (details.open = false), { once: true });
      });
      return { details, draw };
    };
    this.timing = part("timing and losses", () => this.timingRows());
    this.values = part("all values", () => this.valueTables());
    this.log = part("log of commands", () => this.logRows());
    this.segments = part("values by segment", () => (this.seen.report?.tables ?? []).map(({ title, columns, rows }) => tableOf(title, columns, rows)));
  }

  /** @param {import("./marks.js").Seen} seen @param {import("./frames.js").Frame} frame */
  draw(seen, frame) {
    this.seen = seen;
    if (frame.timing || frame.losses) this.timing.draw();
    if (frame.values || frame.status) this.values.draw();
    if (frame.log) this.log.draw();
    this.segments.details.hidden = !seen.report?.tables.length;
    if (frame.report) this.drawReport(frame.report);
  }

  timingRows() {
    const { timing = {}, losses = {} } = this.seen;
    const lost = Object.entries(losses).filter(([, count]) => count).map(([topic, count]) => `${topic} ${count}`);
    const rows = [...Object.entries(timing), ["messages lost on the way here", lost.join(", ") || "0"]];
    return [tableOf("timing and losses", [], rows)];
  }

  valueTables() {
    const topics = Object.entries({ status: this.seen.status ?? {}, ...this.seen.values });
    const known = topics.filter(([, fields]) => Object.keys(fields).length);
    const tables = known.map(([topic, fields]) => tableOf(inWords(topic), [],
      Object.entries(fields).map(([name, value]) => [inWords(name), siText(value, this.seen.units?.[topic]?.[name])])));
    const { parameters = [] } = this.seen;
    if (parameters.length) tables.push(tableOf("parameters, changed ones first", ["name", "value", "default"], parameters));
    return [make("p", { textContent: "The latest of each topic." }), ...tables];
  }

  logRows() {
    const { log = [], log_thinned: thinned = 0 } = this.seen;
    const rows = [...log].reverse().map((entry) => [`${entry.time.toFixed(3)} s`, entry.kind, entry.text]);
    return [tableOf("log of commands, the newest first", ["time", "kind", "what"], rows), ...(thinned ? [`${thinned} older entries are left out.`] : [])];
  }

  /** Show what a test says of its run, before the screen. @param {import("./frames.js").Report} report */
  drawReport({ verdict, requirements = [], seed, test }) {
    this.report.hidden = !verdict;
    if (!verdict) return;
    const title = make("h2", { textContent: [verdict, test].filter(Boolean).join(" \u00b7 ") });
    title.dataset.verdict = verdict;
    const list = make("ul", {}, ...requirements.map((textContent) => make("li", { textContent })));
    this.report.replaceChildren(title, list, ...(seed === undefined ? [] : [`seed ${seed}`]));
  }
}
