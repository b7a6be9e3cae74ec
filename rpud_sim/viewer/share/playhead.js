// @ts-check
/* The time of a recording that the screen shows: seeking, playing, and jumps to impacts. */
import { element } from "./dom.js";
import { valueText } from "./quantities.js";

const STEP = 90; // between two places while it plays [ms]
const CONTACT = 1e-4; // length of a contact that is not known [s]

/** Place in a recording, with its buttons. */
export class Playhead {
  /** @param {(request: Record<string, any>) => void} send @param {() => void} onMove */
  constructor(send, onMove) {
    this.send = send;
    this.onMove = onMove;
    this.time = NaN; // [s]
    this.moved = false; // by the reader; before, it is at the start, or where the address says
    /** @type {number | null} */ this.wanted = null; // by the address [s]
    this.playing = 0; // when it moved last [ms]; 0 while it stands
    /** @type {[number, number]} */ this.whole = [0, 0]; // ends of the recording
    /** @type {[number, number] | null} */ this.contact = null; // ends of the contact that was found last
    element("previous").onclick = () => this.jump("previous");
    element("next").onclick = () => this.jump("next");
    element("play").onclick = () => this.toggle();
  }

  /** @param {import("./marks.js").Seen} seen @param {import("./frames.js").Frame} frame */
  draw({ mode, extent: [first, last] = [0, 0], begin: from = first }, { jump }) {
    this.whole = [first, last];
    const begin = Math.min(Math.max(this.wanted ?? from, first), last); // of a report, where its first numbers are
    if (mode && mode !== "live" && !this.moved && begin !== this.time) this.seek(begin, false);
    if (!jump) return;
    const { time, peak_force: peak, contact_duration: contact = CONTACT, none = "" } = jump;
    element("contact", HTMLButtonElement).disabled = time === undefined;
    element("found").textContent = time === undefined ? none : `impact at ${time.toFixed(9)} s, ${valueText("peak_force", peak)}`;
    if (time === undefined) return;
    this.contact = [time - 0.5 * contact, time + 1.5 * contact];
    this.seek(time);
  }

  /** @param {number} time [s] @param {boolean} moved by the reader */
  seek(time, moved = true) {
    this.moved ||= moved;
    this.time = Math.max(this.whole[0], Math.min(time, this.whole[1]));
    this.send({ playhead: this.time });
    this.onMove();
  }

  /** Go to an impact. @param {"next" | "previous"} which */
  jump(which) { this.send({ seek: which, from: this.time }); }

  toggle() {
    this.playing = this.playing ? 0 : performance.now();
    const [first, last] = this.whole;
    if (this.playing && this.time >= last) this.time = first;
    element("play").ariaPressed = String(this.playing > 0);
    element("play").textContent = this.playing ? "Pause" : "Play";
    if (this.playing) requestAnimationFrame((now) => this.step(now));
    else this.onMove();
  }

  /** @param {number} now [ms] */
  step(now) {
    if (!this.playing) return;
    const passed = Math.min(now - this.playing, 1000);
    if (passed > STEP) {
      this.playing = now;
      this.seek(this.time + (passed / 1e3) * Number(element("speed", HTMLSelectElement).value));
      if (this.time >= this.whole[1]) this.toggle();
    }
    requestAnimationFrame((next) => this.step(next));
  }
}
