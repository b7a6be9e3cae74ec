// @ts-check
/* One slow-motion clock for the section of the drill and for the plot of its motion. */

/** @typedef {import("./frames.js").Section} Section */

const CLOCK_PAUSE = 36; // ms from a picture to the request for the next: 20 to 25 a second
const CLOCK_REST = 0.7; // s that the last impact is still seen at the end of a block
const CLOCK_STILL = 1000; // ms between two pictures for who wants no motion

/** Place in the block of motion that is shown. */
export class MotionClock {
  constructor() {
    /** @type {Section | null} */ this.block = null;
    /** @type {Section | null} */ this.next = null;
    this.speed = 5; // ms of motion in a second
    this.place = 0; // of the picture, from the first sample [s]
    this.rest = 0; // for which the clock has stood at the end of the block [s]
    this.held = false; // by the reader
    this.onWant = () => {}; // asks for the newest block
    /** @type {((changed: boolean) => void)[]} */ this._listeners = [];
    this._changed = false; // another block than at the step before
    this._reached = 0; // place without regard to contacts [s]
    this._frame = this._timer = this._before = 0;
    this._asked = this._told = -Infinity; // [ms]
    this._reduced = matchMedia("(prefers-reduced-motion: reduce)");
    this._reduced.addEventListener("change", () => this._start());
  }

  /** Last sample's place in the block [s]. */
  get end() { return this.block ? (this.block.free_mass.length - 1) * this.block.period : 0; }

  /** Number of the sample at the place. */
  get sample() { return this.block ? Math.round(this.place / this.block.period) : 0; }

  /** Whether the block is at its end, and no other waits. */
  get resting() { return !!this.block && !this.next && !this.held && this.place >= this.end; }

  /** Call a function after each step; `changed` says that it is another block, or none.
   * @param {(changed: boolean) => void} listener */
  listen(listener) {
    this._listeners.push(listener);
    listener(true);
  }

  /** Show a block after the current one; the newest replaces one that waits. @param {Section} section */
  set(section) {
    const last = this.next ?? this.block;
    if (!section.free_mass.length) return;
    if (last?.time === section.time) { // more of its impacts may be known
      last.impacts = section.impacts;
      this._changed = true;
      return this._start();
    }
    this.next = section;
    this._asked = -Infinity;
    this._start();
  }

  /** Show a block at once. @param {Section} section @param {boolean} still at its last sample: the drill stands there */
  jump(section, still = false) {
    if (!section.free_mass.length) return this.clear();
    this.held = false;
    this.next = section;
    this._advance();
    if (still || this._reduced.matches) this._reached = this.place = this.end;
    this._tell();
    this._start();
  }

  /** Forget everything: there is no motion yet. */
  clear() {
    this.held = false;
    this.next = null;
    this._advance();
    this._tell();
  }

  /** Stay at a place, with the same picture each time. @param {number} place from the first sample [s] */
  still(place) {
    this.held = true;
    this._reached = this.place = Math.min(Math.max(place, 0), this.end);
    this.rest = 0;
    this._tell();
  }

  /** Hold the clock, or let it run: from its place, or once more from the beginning. */
  toggle() {
    if (this.resting) this._reached = this.place = this.rest = 0;
    else this.held = !this.held;
    this._tell();
    this._start();
  }

  _advance() {
    this.block = this.next;
    this.next = null;
    this._asked = -Infinity;
    this._reached = this.place = this.rest = 0;
    this._changed = true;
  }

  _tell() {
    const changed = this._changed;
    this._changed = false;
    this._told = performance.now();
    for (const listener of this._listeners) listener(changed);
  }

  /** @param {number} pause before the next step [ms] */
  _start(pause = 0) {
    clearTimeout(this._timer);
    // Blocks may come at any time: who wants no motion sees them when the second is over.
    if (this._reduced.matches) pause = Math.max(0, this._told + CLOCK_STILL - performance.now());
    if (this._frame || (!this.block && !this.next)) return;
    // A hidden tab has no pictures: the clock stands until it is seen again.
    this._timer = setTimeout(() => { this._frame = requestAnimationFrame((now) => this._step(now)); }, pause);
  }

  /** @param {number} now [ms] */
  _step(now) {
    const passed = Math.min(Math.max(now - this._before, 0), 100) / 1e3, still = this._reduced.matches;
    this._before = now;
    this._frame = 0;
    if (this.held) return;
    if (this.next && (still || this._reached >= this.end)) this._advance();
    else this._reached += (passed * this.speed) / 1e3;
    if (still) this._reached = this.end;
    if (this._reached > 0.7 * this.end && !this.next && now - this._asked > 1000) {
      this._asked = now;
      this.onWant();
    }
    this._reached = Math.min(this._reached, this.end);
    if (this.place >= this.end) this.rest += passed;
    // A contact is shorter than the time between two pictures: it gets one, at its middle.
    const struck = (this.block?.impacts ?? []).map(([time, , length]) => time + (length || 0) / 2);
    this.place = (still ? null : struck.find((time) => time > this.place && time <= this._reached)) ?? this._reached;
    this._tell();
    this._start(this.resting && this.rest > CLOCK_REST ? 1000 : CLOCK_PAUSE);
  }
}
