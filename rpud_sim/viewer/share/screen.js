// @ts-check
/* The screen: shows the frames of a source, and asks it for what the reader wants to see. */
import { MotionClock } from "./clock.js";
import { Controls } from "./controls.js";
import { Details } from "./details.js";
import { element, elements } from "./dom.js";
import { saveCsv, savePng } from "./export.js";
import { FrozenSource } from "./frozen_source.js";
import { wordsAt } from "./marks.js";
import { mountMotion } from "./motion.js";
import { Numbers } from "./numbers.js";
import { Playhead } from "./playhead.js";
import { PlotColumn } from "./plots.js";
import { clockText, setQuantities, timeText } from "./quantities.js";
import { mountSection } from "./section.js";
import { SocketSource } from "./socket_source.js";
import { inContact, stateOf } from "./state.js";
import { Timeline } from "./timeline.js";

const LEAST = 1e-6; // time in view [s]
const ASKED = 60; // between two requests for another view [ms]
const ZOOM = 1.6; // by one key
const SILENT = 2; // without data from here on a live screen says so [s]
const KEPT = 300; // after so long a view is written into the address [ms]
const SURE = 3; // impacts that a block has by the mean rate; one with none is of another time

/** All that frames have said of this run, and what the reader looks at. */
class Screen {
  constructor() {
    for (const each of elements(".static")) each.remove(); // what a report says without scripts
    /** @type {import("./marks.js").Seen} */ this.seen = {};
    /** @type {import("./marks.js").Range | null} */ this.zoomed = null; // null: follow the drill, or show all
    this.follow = 20; // of a live drill, in view [s]; infinite for the whole run
    this.pointed = NaN; // time at the cursor [s]
    this.keeping = 0;
    this.fresh = performance.now(); // when the drill said something new [ms]
    this.asking = false;
    this.gone = ""; // when the server went
    this.heard = performance.now(); // when its last frame came [ms]
    this.reason = "";
    this.shown = ""; // state that the moving section shows
    this.jumps = false; // whether the next block is shown at once
    this.since = -Infinity; // time from which on blocks show what the screen says [s]
    this.clock = new MotionClock();
    this.clock.onWant = () => this.source.send({ section: true });
    this.section = mountSection(element("section"), this.clock);
    mountMotion(element("motion"), this.clock);
    this.numbers = new Numbers(element("numbers"));
    this.plots = new PlotColumn(element("plots"), element("motion"), this, () => this.ask());
    this.timeline = new Timeline(element("timeline"), this);
    this.controls = new Controls((request) => this.source.send(request));
    this.details = new Details(element("details"), element("report"));
    this.playhead = new Playhead((request) => this.source.send(request), () => this.reveal());
    this.clock.listen((changed) => changed && this.drawTime());
    this.recall();
    this.listen();
    const Source = elements("script.frame").length ? FrozenSource : SocketSource;
    this.source = new Source((frame) => this.take(frame), (open, reason) => this.connect(open, reason));
    setInterval(() => this.watch(), 250);
  }

  /** Time since the newest data of a live screen, if that is long; else 0 [s]. */
  get age() {
    const age = Math.max((performance.now() - this.heard) / 1e3, this.seen.silent ?? 0);
    return this.seen.mode === "live" && age >= SILENT ? age : 0;
  }

  /** Why nothing comes from the drill, and nothing goes there; "" while it does. */
  get lost() {
    const { connection, mode } = this.seen;
    const state = mode === "live" && connection && connection.state !== "connected" ? connection.state : "";
    return this.gone || this.age || this.seen.error ? "not connected" : state;
  }

  /** Say what the drill does, or that data stop: also where nothing is drawn, as in a hidden tab. */
  watch() {
    document.documentElement.dataset.stale = String(Boolean(this.lost && this.lost !== "searching"));
    this.controls.lose(this.lost);
    const { seen } = this, [word, why, tone] = stateOf(seen, this.lost), texts = { doing: word, why };
    for (const [id, text] of Object.entries(texts)) if (element(id).textContent !== text) element(id).textContent = text;
    element("state").dataset.tone = tone;
    if (!this.past) document.title = [word, why && tone === "good" ? why : "", seen.drill, "rpud"].filter(Boolean).join(" \u2013 ");
    const age = Math.max((performance.now() - this.fresh) / 1e3, this.seen.silent ?? 0);
    element("age").textContent = this.seen.now === undefined ? "" : `data ${age < 10 ? age.toFixed(1) : Math.floor(age)} s old`;
    this.drawBanner();
  }

  /** Whether the screen shows a recording, which has a playhead. */
  get past() { return this.seen.mode !== undefined && this.seen.mode !== "live"; }

  /** @returns {[number, number]} times of the whole run */
  get extent() { return this.seen.extent ?? [0, 1]; }

  /** Whether the view is the newest part of a live drill. */
  get follows() { return !this.zoomed && !this.past && this.follow < Infinity; }

  /** @returns {import("./marks.js").Range} time in view */
  get range() {
    const [start, end] = this.extent;
    return this.zoomed ?? { start: this.follows ? Math.max(start, end - this.follow) : start, end: Math.max(end, start + LEAST) };
  }

  /** Length of the time in view [s]. */
  get span() { return this.range.end - this.range.start; }

  // --- Frames ---

  /** @param {boolean} open @param {string} reason why the connection was closed */
  connect(open, reason) {
    document.documentElement.dataset.connection = open ? "open" : "closed";
    this.gone = open ? "" : this.gone || new Date().toLocaleTimeString();
    [this.reason, this.heard] = [reason, performance.now()];
    this.watch();
    if (!open) return;
    this.ask();
    if (this.past) this.playhead.seek(this.playhead.time, false);
    this.source.send({ section: true });
  }

  /** Draw a frame with the next picture of the browser, and acknowledge it. @param {import("./frames.js").Frame} frame */
  take(frame) {
    this.heard = performance.now();
    if (frame.now !== undefined || this.seen.status?.state !== "running") this.fresh = this.heard;
    const draw = () => (this.draw(frame), this.source.send({ ack: frame.number }));
    document.hidden ? draw() : requestAnimationFrame(draw); // a hidden tab has no pictures, but a title
  }

  /** @param {import("./frames.js").Frame} frame */
  draw(frame) {
    const { run, extent, mode, drill, drills, plots } = this.seen;
    if (frame.run !== undefined && run !== undefined && frame.run !== run) {
      this.seen = { mode, drill, drills, plots };
      this.zoomed = null;
      this.ask();
      this.clock.clear();
    }
    Object.assign(this.seen, frame);
    const { seen } = this;
    if (frame.quantities) setQuantities(frame.quantities);
    if (frame.mode) document.documentElement.dataset.mode = frame.mode;
    // The source knows a whole run only by its ends.
    if ((frame.mode && frame.mode !== mode) || (frame.extent && frame.extent[1] !== extent?.[1] && !this.zoomed && !this.follows)) this.ask();
    if (frame.moves !== undefined) document.documentElement.dataset.moves = String(frame.moves);
    if (frame.plots) this.plots.define(frame.plots);
    if (frame.drill !== undefined || frame.drills) this.drawDrills();
    if (frame.status || frame.values) this.section.setContact(inContact(seen));
    if (frame.hole !== undefined) this.section.setHole(frame.hole);
    this.drawMotion(frame);
    if (frame.numbers) this.numbers.draw(frame.numbers, seen.hole);
    this.playhead.draw(seen, frame);
    seen.at = this.past ? this.playhead.time : undefined;
    document.documentElement.dataset.heard = String(seen.now !== undefined);
    this.controls.draw(seen, frame);
    this.details.draw(seen, frame);
    this.watch();
    this.drawTime();
    document.documentElement.dataset.frame = String(frame.number);
  }

  /** Show the newest motion: at once if the screen says otherwise by now. @param {import("./frames.js").Frame} frame */
  drawMotion(frame) {
    const { status = {}, faults = [] } = this.seen;
    const active = faults.filter((each) => each.active).map((each) => each.number);
    const shown = status.state ? JSON.stringify([status.state, status.regime, status.drive_enabled, active]) : "";
    const changed = shown !== this.shown || (frame.numbers !== undefined && this.contradicts(frame.numbers.impact_rate?.mean));
    if (this.shown && shown !== this.shown) this.since = this.past || status.state !== "running" ? -Infinity : this.seen.now ?? -Infinity;
    this.jumps ||= changed;
    this.shown = shown;
    if (this.jumps && !(frame.section && frame.section.time >= this.since)) this.source.send({ section: true });
    const section = frame.section ?? (this.jumps ? this.clock.next : null); // one that waits, until a newer one comes
    if (!section) return;
    const { time, period, free_mass: { length } } = section;
    if (frame.kept) element("found").textContent = `motion and numbers at ${timeText(time + period * length, 1)}, the nearest of ${frame.kept} moments that the report keeps`;
    if (this.jumps || (this.past && !this.playhead.playing)) this.clock.jump(section, status.state === "paused" && !this.past);
    else this.clock.set(section);
    this.jumps &&= !(frame.section && time >= this.since); // one of before is shown until there is one of after
  }

  /** Whether the moving section strikes and the number of a live drill says that it does not, or the other way round.
   * @param {number | null | undefined} rate of the impacts [1/s] */
  contradicts(rate) {
    const { block, end } = this.clock;
    if (this.past || !block || typeof rate !== "number") return false;
    return block.impacts.length ? rate === 0 : rate * end > SURE;
  }

  drawTime() {
    const { seen, range, span, clock: { block, end } } = this;
    const playhead = this.past ? this.playhead.time : null;
    seen.motion = block ? [block.time, block.time + end] : undefined;
    const live = seen.status?.state === "running" ? 1 : 3; // of a drill that stands, single steps are seen
    element("time").textContent = clockText(playhead ?? seen.now ?? 0, this.past ? Math.min(9, Math.max(1, 2 - Math.floor(Math.log10(span)))) : live);
    element("reach").textContent = this.zoomed ? `${timeText(range.start, span)} to ${timeText(range.end, span)} in view` : "";
    for (const part of [this.plots, this.timeline]) part.draw(seen, range, playhead);
    for (const button of elements("#views button"))
      button.ariaPressed = String(!this.zoomed && Number(button.dataset.follow) === (this.past ? Infinity : this.follow));
    element("back", HTMLButtonElement).disabled = this.follows;
  }

  drawDrills() {
    const { drills = [], drill = "" } = this.seen;
    element("drill").textContent = drill || "recording";
    [element("drill").hidden, element("drills").hidden] = [drills.length > 1, drills.length < 2];
    element("drills").replaceChildren(...drills.map((name) => new Option(name, name, false, name === drill)));
  }

  drawBanner() {
    const { connection, notice, error, read = 1, mode, drill } = this.seen;
    const lost = mode === "live" && connection && connection.state !== "connected" ? connection : null;
    const gone = `The server has gone at ${this.gone}${this.reason && `: ${this.reason}`}. The screen shows what it sent last, and connects again.`;
    const since = lost?.state === "searching" ? `Searching for ${drill}; \`rpud run\` starts a drill` : `${drill} has gone at ${new Date(1e3 * (lost?.since ?? 0)).toLocaleTimeString()}`;
    const late = this.age && `${this.seen.silent ? drill : "The server"} does not answer. What is shown is from before.`;
    const state = error || (this.gone ? gone : late ? late : lost ? `${since}${lost.reason && `: ${lost.reason}`}` : "");
    const text = [state, read < 1 ? `${Math.floor(100 * read)} % of the bag is read.` : "", notice].filter(Boolean).join(" ");
    const banner = element("banner");
    if (banner.textContent !== text) banner.textContent = text;
    banner.dataset.bad = String(Boolean(error || this.gone || late || lost?.state === "vanished"));
  }

  // --- What is in view ---

  /** Ask for what is in view; several changes at once become one request. */
  ask() {
    clearTimeout(this.keeping);
    this.keeping = setTimeout(() => this.keep(), KEPT);
    if (this.asking) return;
    this.asking = true;
    setTimeout(() => {
      this.asking = false;
      const { range: { start, end }, plots: { width, choices } } = this;
      this.source.send({ view: this.follows ? { follow: this.follow, width } : { start, end, width }, choices });
    }, ASKED);
  }

  /** Write the view into the address, so that a reload or a colleague sees the same. */
  keep() {
    const { zoomed, follow, past, playhead, plots } = this;
    const state = new URLSearchParams(Object.entries(plots.choices).map(([plot, choice]) => [`plot ${plot}`, choice]));
    if (zoomed) state.set("view", `${zoomed.start} ${zoomed.end}`);
    if (!past && follow !== 20) state.set("follow", String(follow));
    if (past && playhead.moved) state.set("at", String(playhead.time));
    history.replaceState(null, "", `#${state}`);
  }

  /** Take the view from the address. */
  recall() {
    const state = new URLSearchParams(location.hash.slice(1)), [start, end] = (state.get("view") ?? "").split(" ").map(Number);
    if (end > start) this.zoomed = { start, end };
    this.follow = Number(state.get("follow")) || this.follow;
    this.playhead.wanted = state.has("at") ? Number(state.get("at")) || 0 : null;
    for (const [name, choice] of state) if (name.startsWith("plot ")) this.plots.choices[name.slice(5)] = choice;
  }

  /** @param {number} start @param {number} end */
  zoom(start, end) {
    const [first, last] = this.extent;
    const span = Math.max(LEAST, Math.min(end - start, last - first));
    const from = Math.max(first, Math.min(0.5 * (start + end - span), last - span));
    this.look({ start: from, end: from + span });
  }

  /** @param {import("./marks.js").Range | null} zoomed null: show the whole recording, or follow the drill again */
  look(zoomed) {
    this.zoomed = zoomed;
    this.ask();
    this.drawTime();
  }

  /** @param {number} factor @param {number} [held] time that stays where it is [s]; else the playhead, or the middle */
  scale(factor, held) {
    const { range: { start, end }, playhead: { time } } = this;
    const at = held ?? (this.past && time >= start && time <= end ? time : 0.5 * (start + end));
    this.zoom(at - factor * (at - start), at + factor * (end - at));
  }

  /** @param {number} shift [s] */
  move(shift) { this.zoom(this.range.start + shift, this.range.end + shift); }

  /** @param {number} time that was clicked at [s] */
  click(time) { if (this.past) this.playhead.seek(time); }

  /** Set a second cursor, or remove it where it is. @param {number} time [s] */
  mark(time) {
    const { seen, span } = this;
    seen.mark = typeof seen.mark === "number" && !(Math.abs(seen.mark - time) > 0.01 * span) ? null : time;
    this.drawTime();
    this.point(this.pointed);
  }

  /** Move the cursor, and with it the values beside the lines. @param {number} share of the view */
  step(share) {
    const { range: { start }, span, pointed, plots: { shown: [{ plot }] } } = this;
    const at = (Number.isFinite(pointed) ? pointed : this.past ? this.playhead.time : start + 0.5 * span) + share * span;
    this.point(Math.min(Math.max(at, start), start + span));
    plot?.setCursor({ left: plot.valToPos(this.pointed, "x"), top: 0 });
  }

  /** Keep the playhead in view. */
  reveal() {
    this.ask();
    const { start, end } = this.range;
    const { time, playing, moved } = this.playhead;
    if (!playing) this.source.send({ section: true });
    if (this.zoomed && moved && (time < start || time > end)) this.move(time - start - (playing ? 0.1 : 0.5) * (end - start));
    else this.drawTime();
  }

  /** @param {number | null} time at the cursor */
  point(time) {
    this.pointed = time ?? NaN;
    const from = this.seen.mark ?? NaN, apart = Number.isFinite(from - this.pointed) ? `\u0394\u00a0${timeText(this.pointed - from, this.span)} \u00b7 ` : "";
    element("cursor").textContent = Number.isFinite(this.pointed) ? apart + wordsAt(this.seen, this.pointed, this.span) : "";
  }

  // --- Hands of the reader ---

  listen() {
    for (const button of elements("#views button"))
      button.onclick = () => {
        const span = Number(button.dataset.follow);
        if (!this.past) this.follow = span;
        if (this.past && span < Infinity) this.zoom(this.playhead.time - 0.5 * span, this.playhead.time + 0.5 * span);
        else this.look(null);
      };
    element("back").onclick = () => this.look(null);
    const name = () => `${(this.seen.drill ?? "").replace(/\W+/g, "_").replace(/^_/, "") || "rpud"}_${this.range.start.toFixed(1)}_${this.range.end.toFixed(1)}`;
    element("csv").onclick = () => saveCsv(this.plots.shown, this.range, name());
    element("png").onclick = () => savePng(this.plots.shown, this.seen.drill ?? "", name());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.drawTime());
    element("contact").onclick = () => this.playhead.contact && this.zoom(...this.playhead.contact);
    const drills = element("drills", HTMLSelectElement);
    drills.onchange = () => (location.search = String(new URLSearchParams({ namespace: drills.value })));
    /** @type {Record<string, () => void>} */
    const keys = {
      ArrowLeft: () => this.move(-0.25 * this.span), ArrowRight: () => this.move(0.25 * this.span),
      "+": () => this.scale(1 / ZOOM), "-": () => this.scale(ZOOM), Home: () => this.look(null),
      n: () => this.playhead.jump("next"), p: () => this.playhead.jump("previous"), " ": () => this.playhead.toggle(),
      m: () => this.mark(Number.isFinite(this.pointed) ? this.pointed : this.past ? this.playhead.time : this.seen.now ?? 0),
      ",": () => this.step(-0.01), ".": () => this.step(0.01), "?": () => element("keys").showPopover(),
    };
    document.addEventListener("keydown", (event) => {
      const busy = event.target instanceof Element && event.target.closest(`input, select, [popover], .wide${event.key === " " ? ", button, summary" : ""}`);
      // One reader's key must not pause a drill that others use.
      const absent = !this.past && "np ".includes(event.key);
      if (busy || absent || event.ctrlKey || event.metaKey || event.altKey || !Object.hasOwn(keys, event.key)) return;
      event.preventDefault();
      keys[event.key]();
    });
    const wheel = (/** @type {WheelEvent} */ event) => {
      const across = event.deltaX || (event.shiftKey ? event.deltaY : 0);
      if (!(event.ctrlKey || across) || !(event.target instanceof Element)) return;
      event.preventDefault();
      if (!event.ctrlKey) return this.move((across / this.plots.width) * this.span);
      const { left, width } = event.target.closest("#plots .u-over")?.getBoundingClientRect() ?? { left: 0, width: 0 };
      this.scale(Math.exp(0.002 * event.deltaY), width ? this.range.start + ((event.clientX - left) / width) * this.span : undefined);
    };
    /** @type {Map<number, number>} */ const held = new Map(); // places by pointer [px]: fingers, or the mouse with Shift
    let moved = false;
    const hold = (/** @type {PointerEvent} */ event) => {
      const { type, target, pointerId: number, clientX, shiftKey } = event, area = target instanceof Element && target.closest(".u-over");
      if (!area || (type === "pointerdown" ? event.button || (event.pointerType !== "touch" && !shiftKey) : !held.has(number))) return;
      if (type === "pointerdown") return area.setPointerCapture(number), (moved = false), void held.set(number, clientX);
      const { left, width } = area.getBoundingClientRect(), [first, last] = area.closest("#timeline") ? this.extent : [this.range.start, this.range.end];
      const timeAt = (/** @type {number} */ x) => first + ((x - left) / width) * (last - first), before = [...held.values()];
      if (type !== "pointermove") return held.delete(number), moved || !shiftKey || this.mark(timeAt(clientX));
      if (!(moved ||= held.size > 1 || Math.abs(clientX - before[0]) > 3)) return;
      const now = [...held.set(number, clientX).values()], [from, to] = [before, now].map((each) => each.reduce((sum, x) => sum + x / each.length, 0));
      this.move(timeAt(from) - timeAt(to));
      if (now.length === 2) this.scale(Math.abs((before[0] - before[1]) / (now[0] - now[1] || 1)), timeAt(from)); // what is below the fingers stays there
    };
    for (const id of ["plots", "timeline"]) {
      element(id).addEventListener("wheel", wheel, { passive: false });
      for (const kind of /** @type {const} */ (["pointerdown", "pointermove", "pointerup", "pointercancel"])) element(id).addEventListener(kind, hold);
    }
  }
}

export const rpudScreen = new Screen();
