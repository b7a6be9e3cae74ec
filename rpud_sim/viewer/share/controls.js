// @ts-check
/* Header of the screen: what the drill does, and what a reader can ask of it. */
import { inWords, numberText, valueText } from "./quantities.js";

/** @typedef {import("./marks.js").Seen} Seen */

/** @template {HTMLElement} T @param {string} id @param {new () => T} type @returns {T} an element of the page */
export function element(id, type) {
  const found = document.getElementById(id);
  if (!(found instanceof type)) throw new Error(`the page has no ${type.name} #${id}`);
  return found;
}

/** Actions on a running drill; each refusal is written beside the control that caused it. */
export class Controls {
  /** @param {(request: Record<string, any>) => void} send */
  constructor(send) {
    this.send = send;
    /** @type {Seen} */
    this.seen = {};
    this.shown = -1; // number of the last outcome that was written
    this.refused = -1;
    /** @type {HTMLElement | null} */
    this.last = null; // control that acted last
    this.weight = element("weight", HTMLInputElement);
    this.slide = element("slide", HTMLInputElement);
    this.slide.oninput = () => (this.weight.value = this.slide.value);
    this.weight.oninput = () => (this.slide.value = this.weight.value);
    for (const control of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(".control.live"))) {
      const outcome = document.createElement("output");
      outcome.className = "outcome";
      outcome.onclick = () => (outcome.textContent = "");
      control.append(outcome);
    }
    for (const form of document.querySelectorAll("form"))
      form.onsubmit = (event) => {
        event.preventDefault();
        if (form.popover) form.hidePopover();
        this.act(form, form.dataset.act ?? "", this.filled(form));
      };
    for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("button[data-act]")))
      button.onclick = () => this.act(button, button.dataset.act ?? "", JSON.parse(button.dataset.arguments ?? "{}"));
    const drive = element("drive", HTMLButtonElement);
    drive.onclick = () => this.act(drive, "drive", { enabled: !this.seen.status?.drive_enabled });
    for (const popover of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[popover]")))
      popover.addEventListener("toggle", () => {
        const { left = 0, bottom = 0 } = popover.parentElement?.getBoundingClientRect() ?? {};
        popover.style.left = `${Math.max(8, Math.min(left, innerWidth - popover.offsetWidth - 8))}px`;
        popover.style.top = `${bottom + 6}px`;
      });
  }

  /** @param {HTMLElement} origin @param {string} act @param {Record<string, any>} given */
  act(origin, act, given) {
    this.last = origin.closest(".control");
    this.write(this.last, "");
    this.send({ act, arguments: given });
  }

  /** @param {HTMLFormElement} form @returns {Record<string, any>} what is filled in */
  filled(form) {
    /** @type {Record<string, any>} */
    const given = form.dataset.act === "drive" ? { enabled: Boolean(this.seen.status?.drive_enabled) } : {};
    for (const field of form.elements) {
      if (!(field instanceof HTMLInputElement || field instanceof HTMLSelectElement) || !field.name || !field.value) continue;
      given[field.name] = field.type === "number" ? Number(field.value) * Number(field.dataset.scale ?? 1) : field.value;
    }
    return given;
  }

  /** @param {HTMLElement | null} control @param {string} text */
  write(control, text) {
    const outcome = control?.querySelector(".outcome");
    if (outcome) outcome.textContent = text;
  }

  /** @param {Seen} seen @param {Partial<import("./frames.js").Frame>} frame what is new */
  draw(seen, frame) {
    this.seen = seen;
    if (frame.status || frame.connection || frame.faults) this.drawState();
    if (frame.outcomes) this.drawOutcomes(frame.outcomes);
    if (frame.refused) {
      const [count, reason] = frame.refused;
      if (this.refused >= 0 && count > this.refused) this.write(this.last, reason);
      this.refused = count;
    } else if (this.refused < 0) this.refused = 0;
    for (const [id, names] of Object.entries({ kinds: frame.kinds, channels: frame.channels && ["", ...frame.channels] })) {
      if (!names) continue;
      const select = element(id, HTMLSelectElement);
      const { value } = select;
      select.replaceChildren(...names.map((name) => new Option(inWords(name) || "none", name)));
      if (names.includes(value)) select.value = value;
    }
    if (frame.faults) this.drawFaults(frame.faults);
  }

  drawState() {
    const { status = {}, connection, faults = [], mode } = this.seen;
    const lost = mode === "live" && connection && connection.state !== "connected";
    const jammed = faults.some((fault) => fault.active && fault.kind === "free_mass_jammed");
    const running = jammed ? "jammed" : status.regime;
    const state = lost ? connection.state : status.state === "running" ? running : status.state;
    const shown = element("state", HTMLElement);
    shown.dataset.state = state ?? "";
    const text = shown.querySelector("b");
    if (text) text.textContent = state ?? "";
    const pause = element("pause", HTMLButtonElement);
    const stands = status.state === "paused" || status.state === "stopped";
    pause.dataset.act = stands ? "play" : "pause";
    pause.textContent = stands ? "Play" : "Pause";
    const drive = element("drive", HTMLButtonElement);
    drive.ariaPressed = String(Boolean(status.drive_enabled));
    drive.textContent = status.drive_enabled ? "Drive on" : "Drive off";
    element("driven", HTMLButtonElement).textContent =
      `${valueText("drive_voltage", status.drive_voltage)}, ${valueText("drive_frequency", status.drive_frequency)}`;
    const engage = element("engage", HTMLButtonElement);
    engage.textContent = status.regime === "free" ? "Engage" : "Retract";
    engage.dataset.arguments = JSON.stringify({ on: status.regime === "free" });
    element("feed", HTMLFormElement).hidden = !Number.isFinite(status.feed_value);
    const weight = status.weight_on_bit;
    if (Number.isFinite(weight) && weight !== this.pressed) {
      this.pressed = weight;
      while (Number(this.slide.max) < weight) this.slide.max = String(2 * Number(this.slide.max));
      this.weight.value = this.slide.value = String(Number(weight.toPrecision(6)));
      this.weight.dataset.exact = String(weight);
    }
  }

  /** @param {import("./frames.js").Outcome[]} outcomes */
  drawOutcomes(outcomes) {
    const first = this.shown < 0;
    for (const outcome of outcomes) {
      if (outcome.state === "waiting" || outcome.number <= this.shown) continue;
      this.shown = outcome.number;
      if (first) continue; // of another reader, before this page was there
      const bad = outcome.state === "refused" || outcome.state === "failed";
      for (const control of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-of]")))
        if (control.dataset.of?.split(" ").includes(outcome.name)) this.write(control, bad ? outcome.text : "");
    }
    this.shown = Math.max(this.shown, 0);
  }

  /** @param {import("./frames.js").Fault[]} faults */
  drawFaults(faults) {
    const active = faults.filter((fault) => fault.active);
    element("fault", HTMLButtonElement).textContent = active.length ? `Fault (${active.length})` : "Fault";
    element("active", HTMLElement).replaceChildren(
      ...active.map((fault) => {
        const [row, clear] = [document.createElement("li"), document.createElement("button")];
        const of = fault.channel ? ` of ${inWords(fault.channel)}` : "";
        const size = Number.isFinite(fault.magnitude) ? ` ${numberText(/** @type {number} */ (fault.magnitude))}` : "";
        row.append(`${inWords(fault.kind)}${of}${size} since ${fault.onset.toFixed(2)} s`);
        clear.type = "button";
        clear.textContent = "Clear";
        clear.ariaLabel = `clear fault ${fault.number}`;
        clear.onclick = () => this.act(clear, "clear", { which: fault.number });
        row.append(clear);
        return row;
      }),
    );
  }
}
