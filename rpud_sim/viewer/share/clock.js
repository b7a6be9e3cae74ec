// @ts-check
/* One slow-motion clock for the section of the drill and for the plot of its motion. */

/** @typedef {import("./frames.js").Section} Section */

const CLOCK_PAUSE = 32; // ms from a picture to the next request for one: some 25 a second
const CLOCK_FADE = 0.7; // s that the last impact is still seen at the end of a block

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
    this._reached = 0; // place without regard to impacts [s]
    this._wanted = this._ticking = this._fresh = false;
    this._before = this._stilled = 0;
    this._reduced = matchMedia("(prefers-reduced-motion: reduce)");
    this._reduced.addEventListener("change", () => this._start());
    document.addEventListener("visibilitychange", () => this._start());
  }

  /** Last sample's place in the block [s]. */
  get end() {
    return this.block ? (this.block.free_mass.length - 1) * this.block.period : 0;
  }

  /** Number of the sample at the place. */
  get sample() {
    return this.block ? Math.round(this.place / this.block.period) : 0;
  }

  /** Whether the block is at its end, and no other waits. */
  get resting() {
    return !!this.block && !this.next && !this.held && this.place >= this.end;
  }

  /** Call a function after each step; `changed` tells that it is another block, or none.
   * @param {(changed: boolean) => void} listener */
  listen(listener) {
    this._listeners.push(listener);
    listener(true);
  }

  /** Show a block after the present one; the newest replaces one that waits.
   * @param {Section | null} section */
  set(section) {
    this._wanted = false;
    if (!section?.free_mass.length || (this.next || this.block)?.time === section.time) return;
    this.next = section;
    this._start();
  }

  /** Show a block at once; `still`: its last sample, because the drill stands there.
   * @param {Section | null} section @param {boolean} still */
  jump(section, still = false) {
    this._wanted = this.held = false;
    if (!section?.free_mass.length) return this.clear();
    this.next = section;
    this._advance();
    if (still || this._reduced.matches) this._reached = this.place = this.end;
    this._tell();
    this._start();
  }

  /** Forget everything: there is no motion yet. */
  clear() {
    this.block = this.next = null;
    this._wanted = this.held = false;
    this._reached = this.place = this.rest = 0;
    this._fresh = true;
    this._tell();
  }

  /** Show the block at a place and stay there, the same picture each time.
   * @param {number} place after the first sample [s] */
  still(place) {
    this.held = true;
    this._reached = this.place = Math.min(Math.max(place, 0), this.end);
    this.rest = 0;
    this._tell();
  }

  /** Hold the clock, or let it run: from its place, or once more from the beginning. */
  toggle() {
    if (!this.resting) this.held = !this.held;
    if (this.resting) this._reached = this.place = this.rest = 0;
    this._tell();
    this._start();
  }

  _advance() {
    this.block = this.next;
    this.next = null;
    this._reached = this.place = this.rest = 0;
    this._fresh = true;
  }

  _tell() {
    const changed = this._fresh;
    this._fresh = false;
    for (const listener of this._listeners) listener(changed);
  }

  _want() {
    if (this._wanted || this.next) return;
    this._wanted = true;
    this.onWant();
  }

  _start() {
    if (this._ticking || document.hidden || (!this.block && !this.next)) return;
    this._ticking = true;
    this._before = performance.now();
    requestAnimationFrame((now) => this._tick(now));
  }

  /** @param {number} now [ms] */
  _tick(now) {
    const passed = Math.min(Math.max(now - this._before, 0), 100) / 1e3; // a hidden tab stands still
    this._before = now;
    this._ticking = false;
    const pause = this._reduced.matches ? this._stillPicture(now) : this._step(passed);
    if (pause === null) return;
    this._ticking = true;
    setTimeout(() => requestAnimationFrame((next) => this._tick(next)), pause);
  }

  /** Newest block at its end, once a second. @param {number} now [ms] */
  _stillPicture(now) {
    if (this.held) return null;
    if (this.next && now - this._stilled > 900) {
      this._stilled = now;
      this._advance();
      this._reached = this.place = this.end;
      this._tell();
    }
    this._want();
    return document.hidden ? null : 1000;
  }

  /** @param {number} passed [s] @returns {number | null} time to the next step [ms] */
  _step(passed) {
    if (this.held) return null;
    if ((!this.block || this._reached >= this.end) && this.next) this._advance();
    else this._reached += (passed * this.speed) / 1e3;
    if (!this.block) return null;
    if (this._reached > 0.7 * this.end) this._want();
    if (this._reached >= this.end) {
      if (this.place >= this.end) this.rest += passed;
      this._reached = this.place = this.end;
    } else {
      // A contact is shorter than the time between two pictures: the picture is that of the contact.
      const struck = this.block.impacts.map(([time, , length]) => time + (length || 0) / 2)
        .filter((time) => time > this.place && time <= this._reached);
      this.place = struck.pop() ?? this._reached;
    }
    this._tell();
    return this.rest > CLOCK_FADE && !this.next ? null : CLOCK_PAUSE;
  }
}
