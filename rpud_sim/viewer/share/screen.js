// @ts-check
/* The screen: shows the frames of a source, and asks it for what the reader wants to see. */
import { MotionClock } from "./clock.js";
import { Controls } from "./controls.js";
import { Details } from "./details.js";
import { element, elements } from "./dom.js";
import { FrozenSource } from "./frozen_source.js";
import { wordsAt } from "./marks.js";
import { mountMotion } from "./motion.js";
import { Numbers } from "./numbers.js";
import { Playhead } from "./playhead.js";
import { PlotColumn } from "./plots.js";
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
    /** @type {import("./marks.js").Seen} */ this.seen = {};
    /** @type {import("./marks.js").Range | null} */ this.zoomed = null; // null: follow the drill, or show all
    this.follow = FOLLOWED; // [s]; infinite for the whole run
    this.asking = false;
    this.gone = ""; // when the server went
    this.reason = "";
    this.shown = ""; // state that the moving section shows
    this.jumps = false; // whether the next block is shown at once
    /** @type {import("./marks.js").Listener} */
    const listener = {
      zoom: (start, end) => this.zoom(start, end),
      showAll: () => this.showAll(),
      point: (time) => this.point(time),
      click: (time) => this.past && this.playhead.seek(time),
    };
    this.clock = new MotionClock();
    this.clock.onWant = () => this.source.send({ section: true });
    this.section = mountSection(element("section"), this.clock);
    mountMotion(element("motion"), this.clock);
    this.numbers = new Numbers(element("numbers"));
    this.plots = new PlotColumn(element("plots"), element("motion"), listener, () => this.ask());
    this.timeline = new Timeline(element("timeline"), listener);
    this.controls = new Controls((request) => this.source.send(request));
    this.details = new Details(element("details"), element("report"));
    this.playhead = new Playhead((request) => this.source.send(request), () => this.reveal());
    this.listen();
    const frames = elements("script.frame");
    const Source = frames.length ? FrozenSource : SocketSource;
    this.source = new Source(frames, (frame) => this.take(frame), (open, reason) => this.connect(open, reason));
  }

  /** Whether the screen shows a recording, which has a playhead. */
  get past() {
    return this.seen.mode !== undefined && this.seen.mode !== "live";
  }

  /** @returns {[number, number]} times of the whole run */
  get extent() {
    return this.seen.extent ?? [0, 1];
  }

  /** Whether the view is the newest part of a live drill. */
  get follows() {
    return !this.zoomed && !this.past && this.follow < Infinity;
  }

  /** @returns {import("./marks.js").Range} time in view */
  get range() {
    const [start, last] = this.extent;
    const end = this.past ? last : this.seen.now ?? last;
    return this.zoomed ?? { start: this.follows ? Math.max(start, end - this.follow) : start, end: Math.max(end, start + LEAST) };
  }

  // --- Frames ---

  /** @param {boolean} open @param {string} reason why the connection was closed */
  connect(open, reason) {
    document.documentElement.dataset.connection = open ? "open" : "closed";
    this.gone = open ? "" : this.gone || new Date().toLocaleTimeString();
    this.reason = reason;
    this.drawBanner();
    if (!open) return;
    this.ask();
    if (this.past) this.playhead.go(this.playhead.time);
    this.source.send({ section: true });
  }

  /** Draw a frame with the next picture of the browser, and acknowledge it. @param {import("./frames.js").Frame} frame */
  take(frame) {
    requestAnimationFrame(() => {
      this.draw(frame);
      document.documentElement.dataset.frame = String(frame.number);
      this.source.send({ ack: frame.number });
    });
  }

  /** @param {import("./frames.js").Frame} frame */
  draw(frame) {
    const { run, extent, mode } = this.seen;
    if (frame.run !== undefined && run !== undefined && frame.run !== run) {
      this.seen = { mode, drill: this.seen.drill, drills: this.seen.drills, plots: this.seen.plots };
      this.zoomed = null;
      this.clock.clear();
    }
    Object.assign(this.seen, frame);
    const { seen } = this;
    if (frame.quantities) setQuantities(frame.quantities);
    if (frame.mode) document.documentElement.dataset.mode = frame.mode;
    // The source knows a whole run only by its ends.
    if (frame.mode !== mode || (frame.extent && frame.extent[1] !== extent?.[1] && !this.zoomed && !this.follows)) this.ask();
    if (frame.plots) this.plots.define(frame.plots);
    if (frame.drill !== undefined || frame.drills) this.drawDrills();
    if (frame.status?.regime) this.section.setRegime(frame.status.regime);
    if (frame.hole !== undefined) this.section.setHole(frame.hole);
    this.drawMotion(frame);
    if (frame.numbers) this.numbers.draw(frame.numbers);
    this.playhead.draw(seen, frame);
    this.controls.draw(seen, frame);
    this.details.draw(seen, frame);
    this.drawBanner();
    this.drawTime();
  }

  /** Show the newest motion: at once if the screen says otherwise by now. @param {import("./frames.js").Frame} frame */
  drawMotion(frame) {
    const { status = {}, faults = [] } = this.seen;
    const active = faults.filter((each) => each.active).map((each) => each.number);
    const shown = JSON.stringify([status.state, status.regime, status.drive_enabled, active]);
    if (shown !== this.shown) {
      this.shown = shown;
      this.jumps = true;
      if (!frame.section) this.source.send({ section: true });
    }
    if (!frame.section) return;
    if (this.jumps || (this.past && !this.playhead.playing)) this.clock.jump(frame.section, status.state === "paused" && !this.past);
    else this.clock.set(frame.section);
    this.jumps = false;
  }

  drawTime() {
    const { seen, range } = this;
    const span = range.end - range.start;
    const time = this.past ? this.playhead.time : seen.now;
    element("time").textContent = time === undefined ? "" : timeText(time, this.past ? Math.max(span, 0.01) : 30);
    element("reach").textContent = this.zoomed ? `${timeText(range.start, span)} to ${timeText(range.end, span)} in view` : "";
    for (const part of [this.plots, this.timeline]) part.draw(seen, range, this.past ? this.playhead.time : null);
    for (const button of elements("#views button"))
      button.ariaPressed = String(!this.zoomed && Number(button.dataset.follow) === (this.past ? Infinity : this.follow));
  }

  drawDrills() {
    const { drills = [], drill = "" } = this.seen;
    document.title = `${drill || "recording"} \u2013 rpud`;
    element("drill").textContent = drill || "recording";
    element("drill").classList.toggle("unseen", drills.length > 1);
    const select = element("drills", HTMLSelectElement);
    select.hidden = drills.length < 2;
    select.replaceChildren(...drills.map((name) => new Option(name, name, false, name === drill)));
  }

  drawBanner() {
    const { connection, notice, error, read = 1, mode, drill } = this.seen;
    const lost = mode === "live" && connection && connection.state !== "connected" ? connection : null;
    const parts = [];
    if (error) parts.push(error);
    else if (this.gone) parts.push(`The server has gone at ${this.gone}${this.reason ? `: ${this.reason}` : ""}. The screen shows what it sent last, and connects again.`);
    else if (lost) {
      const since = new Date(1e3 * lost.since).toLocaleTimeString();
      const what = lost.state === "searching" ? `Searching for ${drill}` : `${drill} has gone at ${since}`;
      parts.push(`${what}${lost.reason ? `: ${lost.reason}` : ""}`);
    }
    if (read < 1) parts.push(`${Math.floor(100 * read)} % of the bag is read.`);
    if (notice) parts.push(notice);
    const banner = element("banner");
    const text = parts.join(" ");
    if (banner.textContent !== text) banner.textContent = text;
    banner.hidden = !text;
    banner.dataset.bad = String(Boolean(error || this.gone || lost?.state === "vanished"));
  }

  // --- What is in view ---

  /** Ask for what is in view; several changes at once become one request. */
  ask() {
    if (this.asking) return;
    this.asking = true;
    setTimeout(() => {
      this.asking = false;
      const { range: { start, end }, plots: { width, choices } } = this;
      this.source.send({ view: this.follows ? { follow: this.follow, width } : { start, end, width }, choices });
    }, ASKED);
  }

  /** @param {number} start @param {number} end */
  zoom(start, end) {
    const [first, last] = this.extent;
    const span = Math.max(LEAST, Math.min(end - start, last - first));
    const from = Math.max(first, Math.min(0.5 * (start + end - span), last - span));
    this.zoomed = { start: from, end: from + span };
    this.ask();
    this.drawTime();
  }

  /** Show the whole recording, or follow the drill again. */
  showAll() {
    this.zoomed = null;
    this.ask();
    this.drawTime();
  }

  /** @param {number} factor @param {number} at time that stays where it is [s] */
  scale(factor, at) {
    const { start, end } = this.range;
    this.zoom(at - factor * (at - start), at + factor * (end - at));
  }

  /** @param {number} share of the range in view */
  move(share) {
    const { start, end } = this.range;
    this.zoom(start + share * (end - start), end + share * (end - start));
  }

  /** Keep the playhead in view. */
  reveal() {
    const { start, end } = this.range;
    const { time, playing } = this.playhead;
    const shift = time - start - (playing ? 0.1 : 0.5) * (end - start);
    if (this.zoomed && (time < start || time > end)) this.zoom(start + shift, end + shift);
    else this.drawTime();
  }

  /** @param {number | null} time at the cursor */
  point(time) {
    const { start, end } = this.range;
    element("cursor").textContent = time === null ? "" : wordsAt(this.seen, time, end - start);
  }

  // --- Hands of the reader ---

  /** Time that stays when the view is scaled: that of the playhead, else the middle [s]. */
  get middle() {
    const { start, end } = this.range;
    const { time } = this.playhead;
    return this.past && time >= start && time <= end ? time : 0.5 * (start + end);
  }

  listen() {
    for (const button of elements("#views button"))
      button.onclick = () => {
        const span = Number(button.dataset.follow);
        if (!this.past) this.follow = span;
        if (this.past && span < Infinity) this.zoom(this.playhead.time - 0.5 * span, this.playhead.time + 0.5 * span);
        else this.showAll();
      };
    element("contact").onclick = () => this.playhead.contact && this.zoom(...this.playhead.contact);
    element("drills", HTMLSelectElement).onchange = (event) => {
      location.search = String(new URLSearchParams({ namespace: /** @type {HTMLSelectElement} */ (event.target).value }));
    };
    /** @type {Record<string, () => void>} */
    const keys = {
      ArrowLeft: () => this.move(-0.25),
      ArrowRight: () => this.move(0.25),
      "+": () => this.scale(1 / ZOOM, this.middle),
      "-": () => this.scale(ZOOM, this.middle),
      Home: () => this.showAll(),
      n: () => this.past && this.playhead.jump("next"),
      p: () => this.past && this.playhead.jump("previous"),
      " ": () => element(this.past ? "play" : "pause").click(),
    };
    document.addEventListener("keydown", (event) => {
      const busy = event.target instanceof Element && event.target.closest("input, select, button, summary, [popover], .wide");
      if (busy || event.ctrlKey || event.metaKey || event.altKey || !Object.hasOwn(keys, event.key)) return;
      event.preventDefault();
      keys[event.key]();
    });
    const wheel = (/** @type {WheelEvent} */ event) => {
      if (!event.ctrlKey || !(event.target instanceof Element)) return;
      event.preventDefault();
      const { left, width } = (event.target.closest(".u-over") ?? event.target).getBoundingClientRect();
      const { start, end } = this.range;
      const inPlot = event.target.closest("#plots .u-over");
      this.scale(Math.exp(0.002 * event.deltaY), inPlot ? start + ((event.clientX - left) / width) * (end - start) : this.middle);
    };
    for (const id of ["plots", "timeline"]) element(id).addEventListener("wheel", wheel, { passive: false });
  }
}

export const rpudScreen = new Screen();
