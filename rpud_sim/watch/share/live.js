/* Page of a drill: shows the frames that the server sends, and asks for actions.
 *
 * A frame is acknowledged when it has been painted. Data of the plots live in the browser alone:
 * nothing of them goes back to the server.
 */
"use strict";
var rpudLive = (() => {
  const GROUP = "live";
  const BIN = 0.05; // s
  const find = (id) => document.getElementById(id);
  const FAST = ["nodal_plane_min", "nodal_plane_max", "free_mass_min", "free_mass_max",
    "drill_tool_min", "drill_tool_max", "reacting_force_min", "reacting_force_max", "impacts",
    "peak_force_min", "peak_force_max", "energy", "energy_transferred", "electrical_power",
    "rotation_rate_min", "rotation_rate_max", "torque_min", "torque_max", "drive_torque_min",
    "drive_torque_max", "mount_position_min", "mount_position_max", "feed_min", "feed_max",
    "mount_force_min", "mount_force_max", "depth_min", "depth_max"];
  const SLOW = ["time", "weight_on_bit", "drive_voltage", "electrical_power", "actuator_power",
    "weight_power", "change_power", "load_damper_power", "collision_power", "absorbed_power",
    "stored_power", "depth", "penetration_rate", "vibration_amplitude", "lateness_max", "lag",
    "real_time_factor"];
  const ENVELOPES = { "peak force": ["peak_force", 1e-3], "nodal plane": ["nodal_plane", 1e3],
    "free mass": ["free_mass", 1e3], "drill tool": ["drill_tool", 1e3],
    "reacting force": ["reacting_force", 1], "arm": ["mount_force", 1], "feed": ["feed", 1e3],
    "mount": ["mount_position", 1e3], "depth": ["depth", 1e3],
    "rate of rotation": ["rotation_rate", 1], "of rock and cuttings": ["torque", 1],
    "of the drive": ["drive_torque", 1] };
  const STEPS = { "weight on bit": ["weight_on_bit", 1], "of the vibration": ["actuator_power", 1],
    "into tool and rock": ["absorbed_power", 1],
    "lost in the load damper": ["load_damper_power", 1],
    "lost in collisions": ["collision_power", 1], "electrical": ["electrical_power", 1],
    "late by": ["lateness_max", 1e3] };
  const state = { status: {}, values: {}, impact: null, time: null };
  const tables = [{ first: 0, rows: [] }, { first: 0, rows: [] }];
  const models = {};
  const owners = {}; // names of the figures by those of their sources
  let sources = null, follow = true, mine = null, wantsSection = false, filled = false;
  const listed = {}; // what lists of the page show, as JSON

  // --- Numbers. ---

  function doubles(text) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return new Float64Array(bytes.buffer);
  }

  function number(value, digits) {
    if (value === null || value === undefined || !Number.isFinite(value)) return "–";
    if (digits !== undefined) return value.toFixed(digits);
    if (Number.isInteger(value) && Math.abs(value) < 1e15) return String(value);
    const size = Math.abs(value);
    if (size >= 1e6 || size < 1e-4) return value.toExponential(3);
    const text = value.toPrecision(size >= 1e4 ? 6 : 4);
    return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
  }

  function put(element, text) {
    if (element.textContent !== text) element.textContent = text;
  }

  // --- Series. ---

  function merge(table, part) {
    const { first, kept, columns } = part;
    const values = doubles(part.rows);
    const count = values.length / columns;
    if (!table.rows.length) table.first = first;
    table.rows.length = Math.max(0, Math.min(table.rows.length, first - table.first));
    for (let row = 0; row < count; row += 1)
      table.rows.push(values.subarray(row * columns, (row + 1) * columns));
    if (kept > table.first) {
      table.rows.splice(0, kept - table.first);
      table.first = kept;
    }
  }

  function isSeen(owner) {
    const plot = rpudPlots.plots.get(owner);
    return !plot || plot.visible;
  }

  /* Draws what is in view alone: a page that follows the drill does it several times a second. */
  function draw() {
    const [{ first: start, rows: all }, slow] = tables;
    const from = follow && mine ? Math.max(0, Math.floor(mine[0] / BIN) - start - 1) : 0;
    const fast = { first: start + from, rows: all.slice(from) };
    const x = Float64Array.from(fast.rows, (_, row) => (fast.first + row) * BIN);
    const until = x.map((value) => value + BIN);
    const seen = (name) => isSeen(owners[name]);
    for (const [name, [column, scale]] of Object.entries(ENVELOPES).filter(([each]) => seen(each))) {
      const [low, high] = ["min", "max"].map((end) => {
        const place = FAST.indexOf(`${column}_${end}`);
        return Float64Array.from(fast.rows, (row) => row[place] * scale);
      });
      const y = low.map((value, row) => (value + high[row]) / 2);
      sources[name].setv({ data: { x, until, low, y, high } }, { sync: false });
    }
    const times = Float64Array.from(slow.rows, (row) => row[0]);
    const now = state.time === null ? [] : [state.time]; // steps last until now
    const xs = Float64Array.from([...times, ...(times.length ? now : [])]);
    for (const [name, [column, scale]] of Object.entries(STEPS).filter(([each]) => seen(each))) {
      const place = SLOW.indexOf(column);
      const values = slow.rows.map((row) => row[place] * scale);
      if (xs.length > values.length) values.push(values[values.length - 1]);
      sources[name].setv({ data: { x: xs, y: Float64Array.from(values) } }, { sync: false });
    }
  }

  // --- The range of time. ---

  function range() {
    const group = rpudPlots.groups.get(GROUP);
    if (!group || state.time === null) return;
    const { range: now } = group;
    if (follow && mine && now && (Math.abs(now[0] - mine[0]) > 1e-9 || Math.abs(now[1] - mine[1]) > 1e-9))
      setFollow(false);
    if (!follow) return;
    const width = Number(find("window").value);
    const end = Math.max(state.time, width);
    mine = [end - width, end];
    group.range = mine;
    for (const plot of group.plots)
      plot.model.x_range.setv({ start: mine[0], end: mine[1] }, { sync: false });
    rpudPlots.setRange(group, ...mine);
  }

  function setFollow(on) {
    follow = on;
    mine = null;
    find("follow").setAttribute("aria-pressed", String(on));
    if (on) range();
  }

  // --- A frame. ---

  function show(frame) {
    if (frame.began) {
      for (const table of tables) table.rows.length = 0;
      Object.assign(state, { status: {}, values: {}, impact: null });
      find("faults").replaceChildren();
      delete listed.faults;
      setFollow(true);
    }
    if (frame.status) state.status = frame.status;
    Object.assign(state, { values: frame.values, impact: frame.impact, time: frame.time });
    merge(tables[0], frame.series);
    merge(tables[1], frame.statuses);
    for (const element of document.querySelectorAll("[data-needs]"))
      element.hidden = !(element.dataset.needs in state.values);
    range();
    draw();
    showMarks(frame);
    showValues(frame);
    showFaults(frame.faults);
    showOutcomes(frame);
    choices(find("kinds"), frame.kinds);
    choices(find("channels"), frame.channels, "none");
    if (frame.flow !== undefined)
      find("flow").innerHTML = frame.flow || '<p class="none">no power flows</p>';
    if (frame.section) rpudSection.set(frame.section);
    document.documentElement.dataset.frame = String(frame.number);
  }

  function showMarks(frame) {
    const commands = frame.marks.filter((mark) => !["inject", "clear", "clear_all", "end"].includes(mark.kind));
    const end = state.time ?? 0;
    const faults = frame.faults.filter((fault) => fault.onset !== null);
    const key = JSON.stringify([commands.map((mark) => mark.time), faults.map((each) => [each.onset, each.end ?? end])]);
    if (listed.marks === key) return;
    listed.marks = key;
    models["marks command"].setv({ data: { time: Float64Array.from(commands, (mark) => mark.time),
      end: Float64Array.from(commands, (mark) => mark.time) } }, { sync: false });
    models["marks fault"].setv({ data: { time: Float64Array.from(faults, (each) => each.onset),
      end: Float64Array.from(faults, (each) => each.end ?? end) } }, { sync: false });
    rpudPlots.setMarks(GROUP, [
      ...commands.map((mark) => ({ kind: "command", time: mark.time, end: null, text: mark.text })),
      ...faults.map((each) => ({ kind: "fault", time: each.onset, end: each.end,
        text: `fault ${each.number}: ${each.kind}${each.channel ? ` of ${each.channel}` : ""}` }))]);
  }

  function showValues(frame) {
    for (const output of document.querySelectorAll("output[data-value]")) {
      let value = state;
      for (const part of output.dataset.value.split(".")) value = value === null || value === undefined ? null : value[part];
      const { unit, scale, digits } = output.dataset;
      if (typeof value === "string") put(output, value);
      else {
        const scaled = Number.isFinite(value) ? value * Number(scale || 1) : NaN;
        const text = number(scaled, digits === undefined ? undefined : Number(digits));
        put(output, text === "–" || !unit ? text : `${text} ${unit}`);
        output.dataset.exact = value === null || value === undefined ? "" : String(value);
      }
    }
    const { status } = state;
    if ("drive_enabled" in status)
      put(find("drive"), status.drive_enabled
        ? `${number(status.drive_voltage)} V, ${number(status.drive_frequency)} Hz` : "off");
    const { rotation } = state.values;
    put(find("stalled"), rotation && rotation.stalled ? "stalled" : "");
    const active = frame.faults.filter((each) => each.active);
    put(find("active-faults"), active.length ? active.map((each) => each.kind).join(", ") : "none");
    const fast = tables[0];
    const place = FAST.indexOf("impacts");
    const last = Math.floor((state.time ?? 0) / BIN) - fast.first;
    let count = 0;
    for (let row = Math.max(0, last - 20); row < Math.min(last, fast.rows.length); row += 1)
      count += fast.rows[row][place] || 0;
    put(find("rate"), String(count));
    const lost = Object.entries(frame.lost).filter(([, each]) => each);
    put(find("lost"), lost.length ? lost.map(([topic, each]) => `${topic} ${each}`).join(", ") : "0");
    put(find("dropped"), String(frame.dropped));
    put(find("refusals"), String(frame.refusals[0]));
    put(find("last-refusal"), frame.refusals[1] ? `The latest: ${frame.refusals[1]}` : "");
    banner(frame, active);
  }

  function banner(frame, active) {
    const { connection } = frame;
    const element = find("banner");
    const since = new Date(connection.since * 1e3).toLocaleTimeString();
    const jammed = active.some((each) => each.kind === "free_mass_jammed");
    element.dataset.state = connection.state;
    element.dataset.jammed = String(jammed);
    let text = connection.state === "connected"
      ? `connected since ${since}, run ${frame.run}: ${state.status.state ?? "no status yet"}`
      : connection.state === "searching" ? `searching since ${since}: ${connection.reason}`
        : `vanished at ${since}: ${connection.reason}. What follows is the last that was heard.`;
    if (jammed) text += "; jammed: the free mass does not move";
    if (state.status.commands_lost) text += "; commands are lost, the drill is made safe";
    put(element, text);
  }

  function cell(row, text) {
    const element = row.appendChild(document.createElement("td"));
    element.textContent = text;
    return element;
  }

  function changed(name, content) {
    const key = JSON.stringify(content);
    if (listed[name] === key) return false;
    listed[name] = key;
    return true;
  }

  function showFaults(faults) {
    if (!changed("faults", faults)) return;
    const body = find("faults");
    body.replaceChildren();
    for (const fault of [...faults].reverse().slice(0, 50)) {
      const row = body.appendChild(document.createElement("tr"));
      cell(row, String(fault.number));
      cell(row, fault.kind);
      cell(row, fault.channel || "–");
      cell(row, number(fault.magnitude));
      cell(row, number(fault.onset, 3));
      cell(row, fault.active ? "lasts" : number(fault.end, 3));
      const place = cell(row, "");
      if (fault.active) {
        const button = place.appendChild(document.createElement("button"));
        button.type = "button";
        button.textContent = "Clear";
        button.setAttribute("aria-label", `clear fault ${fault.number}`);
        button.addEventListener("click", () => act("clear", { which: fault.number }));
      }
    }
    if (!faults.length) {
      const none = cell(body.appendChild(document.createElement("tr")), "none");
      none.colSpan = 7;
      none.className = "none";
    }
  }

  const said = (outcome) => `${outcome.name}${outcome.arguments ? ` ${outcome.arguments}` : ""}: `
    + `${outcome.state}${outcome.text ? `: ${outcome.text}` : ""}`;

  function showOutcomes(frame) {
    const { outcomes } = frame;
    if (!changed("outcomes", [outcomes, frame.refusal])) return;
    for (const place of document.querySelectorAll(".outcome[data-of]")) {
      const names = place.dataset.of.split(" ");
      const latest = outcomes.filter((each) => names.includes(each.name)).pop();
      if (!latest) continue;
      place.dataset.outcome = latest.state;
      put(place, said(latest));
    }
    const list = find("outcomes");
    list.replaceChildren();
    for (const outcome of [...outcomes].reverse()) {
      const item = list.appendChild(document.createElement("li"));
      item.value = outcome.number;
      item.dataset.outcome = outcome.state;
      item.textContent = said(outcome);
    }
    if (frame.refusal[0]) {
      const item = list.appendChild(document.createElement("li"));
      item.dataset.outcome = "refused";
      item.textContent = `refused: ${frame.refusal[1]}`;
    }
  }

  function choices(select, names, none) {
    if (!changed(select.id, names)) return;
    const before = select.value;
    select.replaceChildren();
    for (const name of none === undefined ? names : ["", ...names]) {
      const option = select.appendChild(document.createElement("option"));
      option.value = name;
      option.textContent = name || none;
    }
    if ([...select.options].some((option) => option.value === before)) select.value = before;
  }

  // --- Actions. ---

  let counted = 0;
  function act(name, args = {}) {
    counted += 1; // otherwise the same action twice would be no change
    models["rpud-request"].data = { json: [JSON.stringify({ name, arguments: args, counted })] };
  }

  function submit(event) {
    event.preventDefault();
    const form = event.target;
    const args = {};
    for (const field of form.elements) {
      if (!field.name) continue;
      if (field.type === "checkbox") args[field.name] = field.checked;
      else if (field.type === "number") {
        if (field.value !== "") args[field.name] = Number(field.value);
      } else args[field.name] = field.value;
    }
    act(form.dataset.action, args);
  }

  function press(event) {
    const { do: name, on } = event.currentTarget.dataset;
    act(name, on === undefined ? {} : { on: on === "true" });
  }

  // --- Beginning. ---

  function acknowledge(frame) {
    const section = wantsSection;
    wantsSection = false;
    models["rpud-heard"].data = { json: [JSON.stringify({ number: frame, section })] };
  }

  function receive() {
    const frame = JSON.parse(models["rpud-frame"].get_column("json")[0]);
    if (!frame.number) return;
    const began = performance.now();
    show(frame);
    // A hidden tab paints nothing, and so gets nothing. A slow one rests as long as it has worked.
    requestAnimationFrame(() => setTimeout(() => {
      const worked = performance.now() - began;
      setTimeout(() => acknowledge(frame.number), Math.min(Math.max(worked - 30, 0), 1000));
    }));
  }

  function begin() {
    const [found] = window.Bokeh ? Bokeh.documents : [];
    if (!found || !document.querySelector("script.plot-theme")) return false;
    const names = ["rpud-frame", "rpud-heard", "rpud-request", "marks command", "marks fault"];
    for (const name of names) models[name] = found.get_model_by_name(name);
    if (names.some((name) => !models[name])) return false;
    sources = {};
    for (const name of [...Object.keys(ENVELOPES), ...Object.keys(STEPS)])
      sources[name] = found.get_model_by_name(name);
    if (Object.values(sources).some((source) => !source)) return false;
    for (const figure of found.roots())
      for (const { data_source: source } of figure.renderers || [])
        if (source && source.name in sources) owners[source.name] = figure.name;
    filled = true;
    models["rpud-frame"].change.connect(receive);
    rpudSection.onWant(() => { wantsSection = true; });
    found.on_event("connection_lost", lost);
    acknowledge(0); // the page is there
    document.documentElement.dataset.ready = "true";
    return true;
  }

  let gone = false;
  function lost() {
    if (gone) return;
    gone = true;
    const element = find("banner");
    element.dataset.state = "gone";
    element.textContent = "The server of this page has gone. The page goes on when it is back.";
    const timer = setInterval(async () => {
      try {
        const answer = await fetch("/drills");
        if (answer.ok) { clearInterval(timer); location.reload(); }
      } catch { /* not yet */ }
    }, 2000);
  }

  for (const form of document.querySelectorAll("form[data-action]")) form.addEventListener("submit", submit);
  for (const button of document.querySelectorAll("button[data-do]")) button.addEventListener("click", press);
  find("follow").addEventListener("click", () => setFollow(!follow));
  find("window").addEventListener("change", () => setFollow(true));
  document.addEventListener("rpud-whole", () => setFollow(true));
  const timer = setInterval(() => { if (filled || begin()) clearInterval(timer); }, 50);
  return { act, state, tables };
})();
