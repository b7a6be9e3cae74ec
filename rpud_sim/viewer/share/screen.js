// @ts-check
/* The screen: takes frames from a source, and shows them. */
import { MotionClock } from "./clock.js";
import { Controls, element } from "./controls.js";
import { Details } from "./details.js";
import { FrozenSource } from "./frozen_source.js";
import { mountMotion } from "./motion.js";
import { Numbers } from "./numbers.js";
import { PlotColumn, wordsAt } from "./plots.js";
import { setQuantities, timeText } from "./quantities.js";
import { mountSection } from "./section.js";
import { SocketSource } from "./socket_source.js";
import { Timeline } from "./timeline.js";

const LEAST = 1e-6; // time in view [s]
const FOLLOWED = 20; // of a live drill, at first [s]
const ASKED = 60; // between two requests for another view [ms]
const ZOOM = 1.6; // by one key

/** All that frames have said of this run, and what the reader looks at. */
class Screen {
  constructor() {
    /** @type {import("./plots.js").Seen} */
    this.seen = {};
    /** @type {import("./plots.js").Range | null} null: follow, or show all */
    this.zoomed = null;
    this.follow = FOLLOWED; // [s]; infinite for the whole run
    /** @type {number | null} */
    this.playhead = null;
    this.playing = 0; // time of the last step of playing; 0 while it stands [ms]
    this.asking = false;
    this.open = false;
    this.gone = "";
    const listener = {
      onZoom: (/** @type {number} */ start, /** @type {number} */ end) => this.zoom(start, end),
      onAll: () => this.showAll(),
      onCursor: (/** @type {number | null} */ time) => this.point(time),
      onClick: (/** @type {number} */ time) => this.past && this.seek(time),
    };
    this.clock = new MotionClock();
    this.clock.onWant = () => this.send({ section: true });
    this.section = mountSection(element("section", HTMLElement), this.clock);
    mountMotion(element("motion", HTMLElement), this.clock);
    this.numbers = new Numbers(element("numbers", HTMLElement));
    this.plots = new PlotColumn(element("plots", HTMLElement), element("motion", HTMLElement), listener, () => this.ask());
    this.timeline = new Timeline(element("timeline", HTMLElement), listener);
    this.controls = new Controls((request) => this.send(request));
    this.details = new Details(element("details", HTMLElement), element("report", HTMLElement));
    this.listen();
    const frames = /** @type {NodeListOf<HTMLScriptElement>} */ (document.querySelectorAll("script.frame"));
    const onFrame = (/** @type {import("./frames.js").Frame} */ frame) => this.take(frame);
    const onState = (/** @type {boolean} */ open, /** @type {string} */ reason) => this.connect(open, reason);
    const address = new URL(`socket${location.search}`, location.href);
    address.protocol = address.protocol.replace("http", "ws");
    this.source = frames.length ? new FrozenSource(frames, onFrame, onState) : new SocketSource(address.href, onFrame, onState);
  }

  /** Whether the run is over, or at least recorded: there is a playhead. */
  get past() {
    return this.seen.mode !== undefined && this.seen.mode !== "live";
  }

  /** @returns {[number, number]} */
  get extent() {
    return this.seen.extent ?? [0, Math.max(this.seen.now ?? 1, 1)];
  }

  /** Range of time in view. @returns {import("./plots.js").Range} */
  get range() {
    const [first, last] = this.extent;
    if (this.zoomed) return this.zoomed;
    if (this.past || this.follow === Infinity) return { start: first, end: last };
    const now = this.seen.now ?? last;
    return { start: now - this.follow, end: now };
  }

  /** @param {Record<string, any>} request */
  send(request) {
    this.source?.send(request);
  }

  /** @param {boolean} open @param {string} reason */
  connect(open, reason) {
    this.open = open;
    document.documentElement.dataset.connection = open ? "open" : "closed";
    if (open) {
      this.gone = "";
      if (this.seen.drill !== undefined && this.seen.mode === "live") this.send({ drill: this.seen.drill });
      this.ask();
      if (this.playhead !== null) this.send({ playhead: this.playhead });
      this.send({ section: true });
    } else this.gone ||= new Date().toLocaleTimeString();
    this.reason = reason;
    this.drawBanner();
  }

  /** Take a frame; it is drawn, and acknowledged, with the next picture of the browser.
   * @param {import("./frames.js").Frame} frame */
  take(frame) {
    requestAnimationFrame(() => {
      this.draw(frame);
      document.documentElement.dataset.frame = String(frame.number);
      this.send({ ack: frame.number });
    });
  }

  /** @param {import("./frames.js").Frame} frame */
  draw(frame) {
    const before = this.seen;
    if (frame.run !== undefined && before.run !== undefined && frame.run !== before.run) {
      const { mode, plots, drills, drill, kinds, channels } = before;
      this.seen = { mode, plots, drills, drill, kinds, channels };
      this.zoomed = null;
      this.clock.clear();
    }
    Object.assign(this.seen, frame);
    const { seen } = this;
    if (frame.quantities) setQuantities(frame.quantities);
    if (frame.mode) {
      document.documentElement.dataset.mode = frame.mode;
      if (this.past) this.playhead ??= this.extent[0];
    }
    if (frame.plots) this.plots.define(frame.plots);
    if (frame.drill !== undefined || frame.drills) this.drawDrills();
    if (frame.hole !== undefined) this.section.setHole(frame.hole);
    if (frame.section) this.drawMotion(frame.section, frame, before);
    else if (this.contradicts(frame, before)) this.send({ section: true });
    if (frame.numbers) this.numbers.draw(frame.numbers);
    if (frame.jump) this.jump(frame.jump);
    this.controls.draw(seen, frame);
    this.details.draw(seen, frame);
    this.drawBanner();
    this.drawTime();
  }

  /** Whether a frame shows something that the moving section does not: a fault, a pause, another drive.
   * @param {import("./frames.js").Frame} frame @param {import("./plots.js").Seen} before */
  contradicts(frame, before) {
    const of = (/** @type {import("./plots.js").Seen} */ seen) =>
      JSON.stringify([seen.status?.state, seen.status?.regime, seen.status?.drive_enabled, seen.faults?.filter((each) => each.active).length]);
    this.shown ??= of(before);
    const now = of({ ...before, ...frame });
    const changed = now !== this.shown;
    this.shown = now;
    this.jumps ||= changed;
    return changed;
  }

  /** @param {import("./frames.js").Section} section @param {import("./frames.js").Frame} frame
   * @param {import("./plots.js").Seen} before */
  drawMotion(section, frame, before) {
    this.contradicts(frame, before);
    const stands = this.seen.mode === "live" && this.seen.status?.state === "paused";
    if (this.jumps || (this.past && !this.playing)) this.clock.jump(section, stands);
    else this.clock.set(section);
    this.jumps = false;
  }

  drawTime() {
    const { seen, range, playhead } = this;
    const span = range.end - range.start;
    const time = this.past ? playhead : seen.now;
    element("time", HTMLOutputElement).textContent = time === null || time === undefined ? "" : this.past ? timeText(time, Math.max(span, 0.01)) : `${time.toFixed(1)}\u00a0s`;
    element("reach", HTMLElement).textContent = this.zoomed ? `${timeText(range.start, span)} to ${timeText(range.end, span)} in view` : "";
    this.plots.draw(seen, range, this.past ? playhead : null);
    this.timeline.draw(seen, range, this.past ? playhead : null);
    for (const button of element("views", HTMLElement).querySelectorAll("button")) {
      const follow = button.dataset.follow ? Number(button.dataset.follow) : Infinity;
      button.ariaPressed = String(!this.zoomed && (this.past ? follow === Infinity : follow === this.follow));
    }
  }

  drawDrills() {
    const { drills = [], drill = "" } = this.seen;
    document.title = `${drill} \u2013 rpud`;
    element("drill", HTMLElement).textContent = drill;
    const select = element("drills", HTMLSelectElement);
    select.hidden = drills.length < 2;
    element("drill", HTMLElement).classList.toggle("unseen", drills.length > 1);
    select.replaceChildren(...drills.map((name) => new Option(name, name, false, name === drill)));
  }

  drawBanner() {
    const { connection, notice, error, read, mode } = this.seen;
    const parts = [];
    if (error) parts.push(error);
    else if (this.gone) parts.push(`The server has gone at ${this.gone}; this is what it sent last. ${this.reason || "The page connects again."}`);
    else if (mode === "live" && connection && connection.state !== "connected") {
      const since = new Date(1e3 * connection.since).toLocaleTimeString();
      parts.push(connection.state === "searching" ? `Searching for ${this.seen.drill}` : `The drill has gone at ${since}`, connection.reason);
    }
    if (read !== undefined && read < 1) parts.push(`${Math.floor(100 * read)} % of the bag is read`);
    if (notice) parts.push(notice);
    const banner = element("banner", HTMLElement);
    const text = parts.filter(Boolean).join(": ");
    if (banner.textContent !== text) banner.textContent = text;
    banner.hidden = !text;
    banner.dataset.bad = String(Boolean(error || this.gone || connection?.state === "vanished"));
  }

  // --- What is in view ---

  /** Ask the source for what is in view; several changes at once become one request. */
  ask() {
    if (this.asking) return;
    this.asking = true;
    setTimeout(() => {
      this.asking = false;
      const { start, end } = this.range;
      const { width, choices } = this.plots;
      const follows = !this.zoomed && !this.past && this.follow < Infinity;
      this.send({ view: follows ? { follow: this.follow, width } : { start, end, width }, choices });
    }, ASKED);
  }

  /** @param {number} start @param {number} end */
  zoom(start, end) {
    const [first, last] = this.extent;
    const span = Math.max(LEAST, Math.min(end - start, last - first));
    const from = Math.max(first, Math.min(0.5 * (start + end - span), last - span));
    this.zoomed = { start: from, end: from + span };
    this.look();
  }

  /** Show the whole run; of a live drill: follow it again. */
  showAll() {
    this.zoomed = null;
    this.look();
  }

  look() {
    this.ask();
    this.drawTime();
  }

  /** @param {number} factor @param {number} [at] time that stays where it is [s] */
  scale(factor, at) {
    const { start, end } = this.range;
    const middle = at ?? (this.playhead !== null && this.playhead >= start && this.playhead <= end ? this.playhead : 0.5 * (start + end));
    this.zoom(middle - factor * (middle - start), middle + factor * (end - middle));
  }

  /** @param {number} share of the range in view */
  move(share) {
    const { start, end } = this.range;
    this.zoom(start + share * (end - start), end + share * (end - start));
  }

  /** @param {number | null} time */
  point(time) {
    const { start, end } = this.range;
    element("cursor", HTMLOutputElement).textContent = time === null ? "" : wordsAt(this.seen, time, end - start);
    this.at = time;
  }

  // --- Playhead ---

  /** Put the playhead to a time. @param {number} time */
  seek(time) {
    const [first, last] = this.extent;
    this.playhead = Math.max(first, Math.min(time, last));
    const { start, end } = this.range;
    if (this.zoomed && (this.playhead < start || this.playhead > end)) {
      const shift = this.playhead - start - (this.playing ? 0.1 : 0.5) * (end - start);
      this.zoom(start + shift, end + shift);
    }
    this.send({ playhead: this.playhead });
    this.drawTime();
  }

  /** @param {{time?: number, contact?: number, none?: string}} jump */
  jump(jump) {
    delete this.seen.jump;
    element("contact", HTMLElement).hidden = jump.time === undefined;
    if (jump.time === undefined) element("cursor", HTMLOutputElement).textContent = jump.none ?? "";
    else {
      this.contact = { start: jump.time - 0.5 * (jump.contact ?? 1e-4), end: jump.time + 1.5 * (jump.contact ?? 1e-4) };
      this.seek(jump.time);
    }
  }

  play() {
    this.playing = this.playing ? 0 : performance.now();
    if (this.playing && this.playhead === this.extent[1] && !this.seen.growing) this.playhead = this.extent[0];
    const button = element("play", HTMLButtonElement);
    button.ariaPressed = String(this.playing > 0);
    button.textContent = this.playing ? "Pause" : "Play";
    if (this.playing) requestAnimationFrame((now) => this.step(now));
  }

  /** @param {number} now [ms] */
  step(now) {
    if (!this.playing) return;
    const passed = Math.max(0, now - this.playing);
    if (passed > 90) {
      this.playing = now;
      this.seek((this.playhead ?? 0) + (Math.min(passed, 1000) / 1e3) * Number(element("speed", HTMLSelectElement).value));
      if (this.playhead === this.extent[1] && !this.seen.growing) this.play();
    }
    requestAnimationFrame((next) => this.step(next));
  }

  // --- Hands of the reader ---

  listen() {
    const on = (/** @type {string} */ id, /** @type {() => void} */ act) => (element(id, HTMLElement).onclick = act);
    const seekImpact = (/** @type {string} */ seek) => this.send({ seek, from: this.playhead ?? this.range.start });
    on("previous", () => seekImpact("previous"));
    on("next", () => seekImpact("next"));
    on("play", () => this.play());
    on("contact", () => this.contact && this.zoom(this.contact.start, this.contact.end));
    on("all", () => {
      this.follow = Infinity;
      this.showAll();
    });
    for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-follow]")))
      button.onclick = () => {
        const span = Number(button.dataset.follow);
        if (this.past) {
          const at = this.playhead ?? 0;
          this.zoom(at - 0.5 * span, at + 0.5 * span);
          return;
        }
        this.follow = span;
        this.showAll();
      };
    element("drills", HTMLSelectElement).onchange = (event) => this.send({ drill: /** @type {HTMLSelectElement} */ (event.target).value });
    /** @type {Record<string, () => void>} */
    const keys = {
      ArrowLeft: () => this.move(-0.25),
      ArrowRight: () => this.move(0.25),
      "+": () => this.scale(1 / ZOOM),
      "-": () => this.scale(ZOOM),
      Home: () => this.showAll(),
      n: () => this.past && seekImpact("next"),
      p: () => this.past && seekImpact("previous"),
      " ": () => (this.past ? this.play() : element("pause", HTMLElement).click()),
    };
    document.addEventListener("keydown", (event) => {
      const busy = event.target instanceof Element && event.target.closest("input, select, textarea, button, summary, [popover], .wide");
      if (busy || event.ctrlKey || event.metaKey || event.altKey || !Object.hasOwn(keys, event.key)) return;
      event.preventDefault();
      keys[event.key]();
    });
    for (const id of ["plots", "timeline"])
      element(id, HTMLElement).addEventListener(
        "wheel",
        (event) => {
          if (!event.ctrlKey) return;
          event.preventDefault();
          this.scale(Math.exp(0.002 * event.deltaY), this.at ?? undefined);
        },
        { passive: false },
      );
  }
}

new Screen();
