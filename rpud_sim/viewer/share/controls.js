// @ts-check
/* Header of the screen: what the drill does, what is commanded, and what a reader can ask of it. */
import { element, elements, make } from "./dom.js";
import { inWords, numberText, valueText } from "./quantities.js";
import { activeFaults, inContact } from "./state.js";

const DONE = 1500; // for which a confirmed action is called so [ms]

/** Actions on a running drill; each outcome is written below the control that caused it. */
export class Controls {
  /** @param {(request: Record<string, any>) => void} send */
  constructor(send) {
    this.send = send;
    /** @type {import("./marks.js").Seen} */ this.seen = {};
    this.lost = ""; // why no action reaches the drill
    this.frame = 0; // number of the last frame
    /** @type {Map<string, HTMLElement>} */ this.pending = new Map(); // controls by the identifiers of their actions
    this.refused = 0; // actions of this page that were not even asked of the drill
    /** @type {HTMLElement | null} */ this.last = null; // control that acted last
    /** @type {Map<string, HTMLElement>} */ this.alarms = new Map(); // rows by fault
    /** @type {Record<string, string>} */ this.written = {}; // what this page wrote last into a field; else a reader did
    this.weight = element("weight", HTMLInputElement);
    this.rate = element("rate", HTMLInputElement);
    for (const control of elements(".control.live")) control.append(make("output", { className: "outcome" }));
    for (const field of elements(".control.live input, .control.live select")) field.oninput = () => this.edited(field);
    for (const field of [this.weight, this.rate]) {
      field.onblur = () => this.drawState();
      field.onkeydown = ({ key }) => { if (key === "Escape") (this.written[field.id] = field.value), field.blur(); };
    }
    for (const button of elements("[data-nudge]")) {
      const field = /** @type {HTMLInputElement} */ (elements("input", button.parentElement ?? document)[0]);
      button.onclick = () => ((field.value = String(Number((Number(field.value) + Number(button.dataset.nudge)).toPrecision(9)))), this.edited(field));
    }
    for (const form of elements("form[data-act]"))
      form.onsubmit = (event) => {
        event.preventDefault();
        if (form.popover) form.hidePopover();
        this.act(form, this.filled(form));
      };
    for (const button of elements("button[data-act]")) button.onclick = () => this.act(button, JSON.parse(button.dataset.arguments ?? "{}"));
    for (const popover of elements("[popover]:not(#keys)"))
      popover.ontoggle = () => {
        const { left = 0, bottom = 0 } = popover.parentElement?.getBoundingClientRect() ?? {};
        popover.style.left = `${Math.max(8, Math.min(left, innerWidth - popover.offsetWidth - 8))}px`;
        popover.style.top = `${Math.max(8, Math.min(bottom - 14, innerHeight - popover.offsetHeight - 8))}px`;
      };
    for (const id of ["kinds", "channels"]) element(id).onchange = () => this.drawForm();
  }

  /** @param {HTMLElement} origin with the name of the action @param {Record<string, any>} given */
  act(origin, given) {
    this.last = origin.closest(".control.live") ?? elements("[data-of~=clear]")[0];
    this.write(this.last, this.lost ? "not connected" : "pending");
    if (this.lost) return;
    const id = Math.random().toString(36).slice(2); // other pages and those before this one ask, too
    this.pending.set(id, this.last);
    this.send({ act: origin.dataset.act, arguments: given, frame: this.frame, id });
  }

  /** Say that nothing reaches the drill now, and what was not confirmed. @param {string} lost why, or "" */
  lose(lost) {
    if (lost === this.lost) return;
    this.lost = lost;
    for (const control of elements(".control.live"))
      if (!lost || [...this.pending.values()].includes(control)) this.write(control, lost && "not connected: not confirmed");
    this.pending.clear();
    this.drawState();
  }

  /** A reason why a command was refused goes when it changes. @param {HTMLElement} field */
  edited(field) {
    this.write(field.closest(".control.live"), "");
    this.drawState();
  }

  /** @param {HTMLElement} form @returns {Record<string, any>} what is filled in */
  filled(form) {
    /** @type {Record<string, any>} */
    const given = form.dataset.act === "drive" ? { enabled: Boolean(this.seen.status?.drive_enabled) } : {};
    for (const field of elements("input, select", form)) {
      const { name, value, type } = /** @type {HTMLInputElement} */ (field);
      const shown = !field.closest("[hidden]");
      if (name && value && shown) given[name] = type === "number" ? Number((Number(value) * Number(field.dataset.scale ?? 1)).toPrecision(12)) : value;
    }
    return given;
  }

  /** @param {HTMLElement | null} control @param {string} text @param {string} [state] */
  write(control, text, state = text) { for (const outcome of control ? elements(".outcome", control) : []) [outcome.textContent, outcome.dataset.state] = [text, state]; }

  /** @param {import("./marks.js").Seen} seen @param {import("./frames.js").Frame} frame what is new */
  draw(seen, frame) {
    this.seen = seen;
    this.frame = frame.number;
    if (frame.outcomes) this.drawOutcomes(frame.outcomes);
    if (frame.refused && frame.refused[0] > this.refused) this.pending.delete([...this.pending.keys()].pop() ?? ""), this.write(this.last, frame.refused[1], "refused");
    this.refused = frame.refused?.[0] ?? this.refused;
    if (frame.kinds) this.drawKinds(frame.kinds);
    this.drawState();
    this.drawAlarms();
  }

  drawState() {
    const { status = {}, faults = [], numbers = {}, values = {}, timing = {} } = this.seen;
    const stands = ["paused", "stopped"].includes(status.state), known = Boolean(status.state);
    const pressed = { plays: !stands, pauses: stands, on: status.drive_enabled, off: !status.drive_enabled,
      engages: status.regime !== "free", retracts: status.regime === "free" };
    for (const [id, is] of Object.entries(pressed)) element(id).ariaPressed = String(known && Boolean(is));
    const { feed_rate: rate, feed_position: place } = status, feeds = [rate, place].some(Number.isFinite); // with an arm the weight on bit follows from the feed
    [element("press").hidden, element("feed").hidden] = [feeds || Number.isFinite(status.mount_position), !feeds]; // or from the mount
    /** @type {Record<string, string>} */
    const texts = { // a recording has no controls, but what was in force
      "in-force": known ? `weight on bit ${valueText("weight_on_bit", status.weight_on_bit)} \u00b7 drive ${status.drive_enabled ? `${valueText("drive_voltage", status.drive_voltage)}, ${valueText("drive_frequency", status.drive_frequency)}` : "off"} \u00b7 ${inContact(this.seen) ? "" : "not "}in the rock` : "",
      stands: stands ? "stands" : known ? "runs" : "",
      "weight-set": `set ${valueText("weight_on_bit", status.weight_on_bit)}`,
      "weight-actual": `reacting ${valueText("reacting_force", numbers.reacting_force?.mean, true, true)}`,
      "feed-set": `set ${Number.isFinite(rate) ? valueText("feed_rate", rate) : valueText("feed", place)}`,
      "feed-actual": `at ${valueText("feed", values.mount?.feed, true, true)}`,
      driven: `set ${valueText("drive_voltage", status.drive_voltage)}, ${valueText("drive_frequency", status.drive_frequency)}`,
      "drive-actual": `tip \u00b1${valueText("vibration_amplitude", status.vibration_amplitude, true, true)}`,
      place: !known ? "" : inContact(this.seen) ? "in the rock" : "not in the rock",
      factor: timing["real-time factor"] ? `\u00d7${Number(timing["real-time factor"]).toFixed(2)}` : "",
      count: faults.length ? `${activeFaults(this.seen).length} active` : "none",
    };
    for (const [id, text] of Object.entries(texts)) if (element(id).textContent !== text) element(id).textContent = text;
    this.follow(this.weight, status.weight_on_bit);
    if (Number.isFinite(rate)) this.follow(this.rate, rate * 1e3);
  }

  /** Let a field follow what is in force. One that a reader edits is never written to: it has the focus, or
   * differs from what was in force when its editing began. Escape gives it back.
   * @param {HTMLInputElement} field @param {number | undefined} value in force, in its unit */
  follow(field, value) {
    if (value === undefined || !Number.isFinite(value)) return;
    const text = String(Number(value.toPrecision(6))), own = document.activeElement === field || field.value !== (this.written[field.id] ?? field.value);
    if (!own) field.value = text;
    const differs = field.value !== "" && Number(field.value) !== Number(text), control = field.closest("[data-of]");
    if (!differs && field.value) this.written[field.id] = field.value;
    field.classList.toggle("pending", differs);
    const [outcome] = control instanceof HTMLElement ? elements(".outcome", control) : [];
    if (differs ? outcome?.textContent : outcome?.dataset.state !== "edited") return;
    this.write(outcome.parentElement, differs ? "not applied yet" : "", differs ? "edited" : "");
  }

  /** @param {import("./frames.js").Outcome[]} outcomes */
  drawOutcomes(outcomes) {
    for (const { asker, state, text } of outcomes) {
      const control = this.pending.get(asker);
      if (!control) continue; // it is another page's
      this.pending.delete(asker);
      this.write(control, state === "done" ? "done" : text, state);
      if (state === "done") setTimeout(() => elements(".outcome", control)[0]?.dataset.state === "done" && this.write(control, ""), DONE);
    }
  }

  /** @param {Record<string, import("./frames.js").FaultForm>} kinds */
  drawKinds(kinds) {
    const select = element("kinds", HTMLSelectElement), { value } = select;
    select.replaceChildren(...Object.keys(kinds).map((name) => new Option(inWords(name), name, false, name === value)));
    this.drawForm();
  }

  /** Ask only for what the chosen kind of fault has. */
  drawForm() {
    const form = this.seen.kinds?.[element("kinds", HTMLSelectElement).value];
    if (!form) return;
    const select = element("channels", HTMLSelectElement), { value } = select, magnitude = element("magnitude", HTMLInputElement);
    select.replaceChildren(...form.channels.map((name) => new Option(inWords(name), name, false, name === value)));
    const size = form.sizes[select.value];
    element("kind-says").textContent = form.says;
    for (const [field, has] of /** @type {const} */ ([[select, form.channels.length > 0], [magnitude, size !== undefined]]))
      if (field.parentElement) field.parentElement.hidden = !has;
    if (!size) return;
    element("meaning").textContent = size[0] ? `${form.meaning} [${size[0]}]` : form.meaning;
    magnitude.placeholder = numberText(size[1]);
  }

  /** A row for each fault that is active, and for lost commands. */
  drawAlarms() {
    const { at, now = 0, status, log = [] } = this.seen, active = activeFaults(this.seen), lost = log.findLast(({ text }) => text.startsWith("commands lost"));
    if (status?.commands_lost) active.push({ number: 0, kind: "commands lost", channel: "", magnitude: 0, size: "", onset: lost?.time ?? now, end: null, active: true });
    const names = active.map(({ number, onset }) => `${number} ${onset}`);
    for (const [name, row] of this.alarms) if (!names.includes(name)) row.remove(), this.alarms.delete(name);
    active.forEach(({ number, kind, channel, size, onset }, place) => {
      let row = this.alarms.get(names[place]);
      if (!row) {
        const clear = make("button", { type: "button", className: "live", textContent: "Clear", ariaLabel: `clear fault ${number}`, hidden: !number });
        clear.dataset.act = "clear", clear.onclick = () => this.act(clear, { which: number });
        const words = [make("b", { textContent: inWords(kind) }), channel && `on ${inWords(channel)}`];
        row = make("li", {}, make("span", {}, ...words.flatMap((each) => (each ? [each, " "] : []))),
          make("span", { textContent: size ? `magnitude ${size}` : "" }), make("span", { ariaHidden: "true" }), clear);
        this.alarms.set(names[place], row);
        element("alarms").append(row);
      }
      const age = `for ${Math.max(0, Math.floor((at ?? now) - onset))} s, since ${onset.toFixed(2)} s`, told = row.children[2];
      if (told.textContent !== age) told.textContent = age;
    });
  }
}
