// @ts-check
/* Header of the screen: what the drill does, and what a reader can ask of it. */
import { element, elements, make } from "./dom.js";
import { inWords, numberText, valueText } from "./quantities.js";

/** Actions on a running drill; each refusal is written beside the control that caused it. */
export class Controls {
  /** @param {(request: Record<string, any>) => void} send */
  constructor(send) {
    this.send = send;
    /** @type {import("./marks.js").Seen} */ this.seen = {};
    this.told = -1; // number of the last outcome that was written
    this.lost = ""; // why no action reaches the drill
    this.frame = 0; // number of the last frame
    /** @type {Map<HTMLElement, string>} */ this.pending = new Map(); // names of actions by their controls
    this.refused = 0; // actions of this page that were not even asked of the drill
    /** @type {HTMLElement | null} */ this.last = null; // control that acted last
    this.weight = element("weight", HTMLInputElement);
    this.slide = element("slide", HTMLInputElement);
    this.slide.oninput = () => (this.weight.value = this.slide.value);
    this.weight.oninput = () => (this.slide.value = this.weight.value);
    for (const control of elements(".control.live")) control.append(make("output", { className: "outcome", onclick: () => this.write(control, "") }));
    for (const form of elements("form[data-act]"))
      form.onsubmit = (event) => {
        event.preventDefault();
        if (form.popover) form.hidePopover();
        this.act(form, this.filled(form));
      };
    for (const button of elements("button[data-act]")) button.onclick = () => this.act(button, JSON.parse(button.dataset.arguments ?? "{}"));
    for (const popover of elements("[popover]"))
      popover.ontoggle = () => {
        const { left = 0, bottom = 0 } = popover.parentElement?.getBoundingClientRect() ?? {};
        popover.style.left = `${Math.max(8, Math.min(left, innerWidth - popover.offsetWidth - 8))}px`;
        popover.style.top = `${bottom + 6}px`;
      };
  }

  /** Forget the counts: another server begins at zero. */
  forget() {
    [this.told, this.refused, this.frame] = [-1, 0, 0];
  }

  /** @param {HTMLElement} origin with the name of the action @param {Record<string, any>} given */
  act(origin, given) {
    this.last = origin.closest(".control.live");
    this.write(this.last, this.lost ? "not connected" : "pending");
    if (this.lost) return;
    if (this.last) this.pending.set(this.last, origin.dataset.act ?? "");
    this.send({ act: origin.dataset.act, arguments: given, frame: this.frame });
  }

  /** Say that nothing reaches the drill now, and what was not confirmed. @param {string} lost why, or "" */
  lose(lost) {
    if (lost === this.lost) return;
    this.lost = lost;
    for (const control of lost ? this.pending.keys() : []) this.write(control, "not connected: not confirmed");
    if (lost) this.pending.clear();
    this.drawState();
  }

  /** @param {HTMLElement} control whose action is done */
  confirm(control) {
    const is = this.pending.delete(control);
    this.write(control, is ? "done" : "");
    if (is) setTimeout(() => elements(".outcome", control)[0]?.textContent === "done" && this.write(control, ""), 1500);
  }

  /** @param {HTMLElement} form @returns {Record<string, any>} what is filled in */
  filled(form) {
    /** @type {Record<string, any>} */
    const given = form.dataset.act === "drive" ? { enabled: Boolean(this.seen.status?.drive_enabled) } : {};
    for (const field of elements("input, select", form)) {
      const { name, value, type } = /** @type {HTMLInputElement} */ (field);
      if (name && value) given[name] = type === "number" ? Number(value) * Number(field.dataset.scale ?? 1) : value;
    }
    return given;
  }

  /** @param {HTMLElement | null} control @param {string} text */
  write(control, text) {
    for (const outcome of control ? elements(".outcome", control) : []) outcome.textContent = text;
  }

  /** @param {import("./marks.js").Seen} seen @param {import("./frames.js").Frame} frame what is new */
  draw(seen, frame) {
    this.seen = seen;
    this.frame = frame.number;
    if (frame.status || frame.connection || frame.faults) this.drawState();
    if (frame.outcomes) this.drawOutcomes(frame.outcomes);
    if (frame.refused && frame.refused[0] > this.refused) {
      this.write(this.last, frame.refused[1]);
      if (this.last) this.pending.delete(this.last);
      this.refused = frame.refused[0];
    }
    for (const [id, names] of /** @type {const} */ ([["kinds", frame.kinds], ["channels", frame.channels && ["", ...frame.channels]]])) {
      if (!names) continue;
      const select = element(id, HTMLSelectElement);
      const { value } = select;
      select.replaceChildren(...names.map((name) => new Option(inWords(name) || "none", name, false, name === value)));
    }
    if (frame.faults) this.drawFaults(frame.faults);
  }

  drawState() {
    const { status = {}, faults = [], at = Infinity } = this.seen, { lost } = this;
    const active = (/** @type {import("./frames.js").Fault} */ { onset, end }) => onset <= at && (end === null || at < end);
    const jammed = faults.some((fault) => active(fault) && fault.kind === "free_mass_jammed");
    const runs = jammed ? "jammed" : status.drive_enabled === false ? "drive off" : status.regime;
    const state = lost || (status.state === "running" ? runs : status.state ?? "");
    element("state").dataset.state = element("doing").textContent = state;
    const stands = status.state === "paused" || status.state === "stopped";
    element("pause").dataset.act = stands ? "play" : "pause";
    element("pause").textContent = stands ? "Play" : "Pause";
    element("drive").ariaPressed = String(Boolean(status.drive_enabled));
    element("drive").textContent = status.drive_enabled ? "Drive on" : "Drive off";
    element("drive").dataset.arguments = JSON.stringify({ enabled: !status.drive_enabled });
    element("driven").textContent = `${valueText("drive_voltage", status.drive_voltage)}, ${valueText("drive_frequency", status.drive_frequency)}`;
    element("engage").textContent = status.regime === "free" ? "Engage" : "Retract";
    element("engage").dataset.arguments = JSON.stringify({ on: status.regime === "free" });
    const feeds = [status.feed_rate, status.feed_position].some(Number.isFinite); // with an arm the weight on bit follows from the feed
    [element("press").hidden, element("feed").hidden] = [feeds, !feeds];
    const weight = status.weight_on_bit;
    if (!Number.isFinite(weight) || weight === this.pressed) return; // what a reader has typed stays
    this.pressed = weight;
    while (Number(this.slide.max) < weight) this.slide.max = String(2 * Number(this.slide.max));
    this.weight.value = this.slide.value = String(Number(weight.toPrecision(6)));
  }

  /** @param {import("./frames.js").Outcome[]} outcomes */
  drawOutcomes(outcomes) {
    const news = outcomes.filter((each) => each.number > this.told);
    // What other readers did before this page was there is not its own.
    for (const { name, state, text } of this.told < 0 ? [] : news)
      for (const control of elements(`[data-of~="${name}"]`)) state === "done" ? this.confirm(control) : (this.pending.delete(control), this.write(control, text));
    this.told = Math.max(0, this.told, ...news.map((each) => each.number));
  }

  /** @param {import("./frames.js").Fault[]} faults */
  drawFaults(faults) {
    const active = faults.filter((fault) => fault.active);
    element("fault").textContent = active.length ? `Fault (${active.length})` : "Fault";
    element("active").replaceChildren(...active.map(({ number, kind, channel, magnitude, onset }) => {
      const size = Number.isFinite(magnitude) ? numberText(/** @type {number} */ (magnitude)) : "";
      const words = [inWords(kind), channel && `of ${inWords(channel)}`, size, `since ${onset.toFixed(2)} s`].filter(Boolean).join(" ");
      const clear = make("button", { type: "button", textContent: "Clear", ariaLabel: `clear fault ${number}` });
      clear.dataset.act = "clear";
      clear.onclick = () => this.act(clear, { which: number });
      return make("li", {}, words, clear);
    }));
  }
}
