/* Page of a bag: the cursor that stays, playing, impacts, and what the server says.
 *
 * plots.js draws the cursor and moves the range of time. The server hears of a new range by itself.
 * Everything else is asked for with the model "rpud-ask", and answered in "rpud-state", as JSON.
 */
"use strict";
var rpudBag = (() => {
  const GROUP = "time";
  const FOLLOW = 0.1; // of the range: where the cursor is after the view has followed it
  const find = (id) => document.getElementById(id);
  let pinned = null; // time of the cursor [s]
  let playing = null; // time of the last frame [ms]
  let ask = null, state = null, asked = 0, order = -1;

  const group = () => rpudPlots.groups.get(GROUP);

  function range() {
    const found = group();
    if (found.range) return found.range;
    for (const plot of found.plots) return [plot.model.x_range.start, plot.model.x_range.end];
    return found.whole;
  }

  function text(value, width) {
    return value.toFixed(Math.min(Math.max(Math.ceil(4 - Math.log10(width)), 3), 12));
  }

  /* Sets the cursor that stays when the pointer leaves; moves the view if it does not show it. */
  function pin(time, { follow = true } = {}) {
    const [low, high] = group().whole;
    pinned = Math.min(Math.max(time, low), high);
    const [start, end] = range();
    const width = end - start;
    if (follow && (pinned < start || pinned > end)) {
      const first = pinned - (playing === null ? 0.5 : FOLLOW) * width;
      rpudPlots.setRange(group(), first, first + width);
    }
    rpudPlots.setCursor(group(), pinned);
    const field = find("time");
    if (document.activeElement !== field) field.value = text(pinned, width);
    field.setAttribute("aria-invalid", "false");
  }

  // --- Playing. ---

  function play(on) {
    playing = on ? performance.now() : null;
    find("play").setAttribute("aria-pressed", String(on));
    find("play").textContent = on ? "stop" : "play";
    if (!on) return;
    if (pinned === null || pinned >= group().whole[1]) pin(range()[0]);
    requestAnimationFrame(frame);
  }

  function frame(now) {
    if (playing === null) return;
    const passed = Math.max(now - playing, 0) / 1e3;
    playing = Math.max(now, playing);
    pin(pinned + passed * Number(find("speed").value));
    if (pinned >= group().whole[1]) play(false);
    else requestAnimationFrame(frame);
  }

  // --- The server. ---

  function send(act, content = {}) {
    asked += 1;
    ask.data = { json: [JSON.stringify({ act, count: asked, ...content })] };
  }

  function ofCursor(act) {
    const [start, end] = range();
    send(act, { time: pinned === null ? 0.5 * (start + end) : pinned });
  }

  function hear() {
    const data = state.data;
    const said = JSON.parse((data.get ? data.get("json") : data.json)[0]);
    find("banner").textContent = said.banner;
    find("banner").hidden = !said.banner;
    find("read").textContent = said.read;
    find("detail").textContent = said.detail;
    find("said").textContent = said.said;
    document.documentElement.dataset.detail = said.kind;
    document.documentElement.dataset.answered = JSON.stringify(said.range);
    listMarks(said.marks);
    if (said.order !== order) {
      order = said.order;
      if (said.show) rpudPlots.setRange(group(), ...said.show);
      if (said.pin !== null) pin(said.pin);
    } else if (pinned !== null && group().cursor === pinned)
      rpudPlots.setCursor(group(), pinned); // the values there may be others now
  }

  let listed = "";
  function listMarks(marks) {
    const now = JSON.stringify(marks);
    if (now === listed) return;
    listed = now;
    rpudPlots.setMarks(GROUP, marks);
    find("marks").replaceChildren(...marks.map((mark) => {
      const row = document.createElement("tr");
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = mark.time.toFixed(6);
      button.setAttribute("aria-label", `cursor to ${mark.time.toFixed(6)} s, ${mark.text}`);
      button.addEventListener("click", () => { play(false); pin(mark.time); });
      const until = mark.kind === "command" ? "" : mark.end === null ? "lasts" : mark.end.toFixed(6);
      for (const content of [button, until, mark.kind, mark.text]) {
        const cell = document.createElement("td");
        cell.append(content); // a text stays a text
        row.append(cell);
      }
      return row;
    }));
  }

  // --- The reader. ---

  function listen() {
    for (const area of document.querySelectorAll(`figure.plot[data-group="${GROUP}"] .plot-area`)) {
      area.addEventListener("click", (event) => {
        const cursor = group().cursor;
        if (cursor !== null && event.detail === 1) pin(cursor);
      });
      area.addEventListener("pointerleave", () => {
        if (pinned !== null) rpudPlots.setCursor(group(), pinned);
      });
      area.addEventListener("keyup", (event) => {
        if (event.shiftKey && event.key.startsWith("Arrow") && group().cursor !== null)
          pin(group().cursor, { follow: false });
      });
    }
    find("play").addEventListener("click", () => play(playing === null));
    for (const button of document.querySelectorAll("button[data-ask]"))
      button.addEventListener("click", () => { play(false); ofCursor(button.dataset.ask); });
    find("time").addEventListener("change", (event) => {
      const time = Number(event.target.value.replace(",", "."));
      const right = event.target.value.trim() !== "" && Number.isFinite(time);
      if (right) pin(time);
      event.target.setAttribute("aria-invalid", String(!right));
    });
    for (const choice of document.querySelectorAll("select[data-plot-number]"))
      choice.addEventListener("change", () =>
        send("choose", { plot: Number(choice.dataset.plotNumber), signal: Number(choice.value) }));
    document.addEventListener("keydown", (event) => {
      if (event.altKey || event.metaKey || event.ctrlKey) return;
      if (event.target.closest("input, select, button, a")) return;
      const impacts = { n: "next", p: "back", c: "contact" };
      if (event.key === " ") play(playing === null);
      else if (event.key in impacts && document.querySelector("button[data-ask]"))
        { play(false); ofCursor(impacts[event.key]); }
      else return;
      event.preventDefault();
    });
  }

  function begin() {
    const documents = window.Bokeh ? Bokeh.documents : [];
    const found = group();
    const models = documents.map((each) =>
      ["rpud-ask", "rpud-state"].map((name) => each.get_model_by_name(name)));
    const pair = models.find(([first, second]) => first && second);
    if (!pair || !found || !found.plots.size) return false;
    [ask, state] = pair;
    state.change.connect(hear);
    listen();
    hear();
    pin(found.whole[0], { follow: false });
    document.documentElement.dataset.drawn = "true";
    return true;
  }

  const timer = setInterval(() => { if (begin()) clearInterval(timer); }, 50);
  return { pin, play, get pinned() { return pinned; }, get playing() { return playing !== null; } };
})();
