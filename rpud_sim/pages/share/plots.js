/* Plots of a page: theme, linked zoom, one cursor with the values at it, keyboard.
 *
 * A plot is a <figure class="plot" data-plot="NAME" data-group="GROUP"> with the Bokeh figure of
 * that name in it. Plots of one group have one range of time. In a file, each plot is drawn from
 * its data when it comes into view. In a page of a server, Bokeh draws the plots, and this script
 * finds them. Models say in their tags, as JSON, by which names their colours go ("paint"), and
 * which values the cursor shows ("read").
 */
"use strict";
var rpudPlots = (() => {
  const STEP = 0.25; // of the range: one press of an arrow
  const ZOOM = 1.6; // one press of + or -
  const NEAR = 6; // pixels within which the cursor names a mark
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const coarse = window.matchMedia("(pointer: coarse)");
  const groups = new Map();
  const plots = new Map();
  let colors = null;

  // --- Groups: a range of time, a cursor, and the plots that show both. ---

  function groupOf(name, own) {
    const key = name || own;
    if (!groups.has(key)) {
      const element = document.querySelector(
        `script.plot-group[data-name="${CSS.escape(key)}"]`);
      const content = element ? JSON.parse(element.textContent) : {};
      groups.set(key, {
        key, named: Boolean(name), plots: new Set(), marks: content.marks || [],
        unit: content.unit === undefined ? "s" : content.unit,
        whole: "begin" in content ? [content.begin, content.end] : null,
        range: null, cursor: null,
        controls: [...document.querySelectorAll(
          `.plot-controls[data-group="${CSS.escape(key)}"]`)],
      });
      listenToControls(groups.get(key));
    }
    return groups.get(key);
  }

  function listenToControls(group) {
    for (const bar of group.controls)
      bar.addEventListener("click", (event) => {
        const button = event.target.closest("button[data-act]");
        if (button) act(group, button.dataset.act);
      });
    showRange(group);
  }

  function currentRange(group) {
    if (group.range) return group.range;
    for (const plot of group.plots) {
      const { start, end } = plot.model.x_range;
      if (Number.isFinite(start) && Number.isFinite(end)) return [start, end];
    }
    return group.whole;
  }

  function setRange(group, start, end) {
    const [low, high] = group.whole || [start, end];
    if (group.whole) {
      const width = Math.min(Math.max(end - start, 1e-9), high - low);
      start = Math.min(Math.max(start, low), high - width);
      end = start + width;
    }
    group.range = [start, end];
    for (const plot of group.plots) applyRange(plot);
    showRange(group);
  }

  function applyRange(plot) {
    const range = plot.group.range;
    if (!range) return;
    plot.stale = !plot.visible;
    if (plot.stale) return; // a plot that nobody sees is drawn when it comes into view
    const { x_range } = plot.model;
    if (x_range.start !== range[0] || x_range.end !== range[1])
      x_range.setv({ start: range[0], end: range[1] });
    placeLine(plot);
  }

  function act(group, what, at) {
    const range = currentRange(group);
    if (!range) return;
    const [start, end] = range;
    const logarithmic = [...group.plots].some((plot) => plot.logarithmic);
    const there = logarithmic ? Math.log : (value) => value;
    const back = logarithmic ? Math.exp : (value) => value;
    const [low, high] = [there(start), there(end)];
    const width = high - low;
    const middle = at === undefined ? low + width / 2 : there(at);
    const part = (middle - low) / width;
    const zoomed = (factor) =>
      setRange(group, back(middle - part * width * factor),
        back(middle + (1 - part) * width * factor));
    if (what === "back") setRange(group, back(low - STEP * width), back(high - STEP * width));
    else if (what === "on") setRange(group, back(low + STEP * width), back(high + STEP * width));
    else if (what === "in") zoomed(1 / ZOOM);
    else if (what === "out") zoomed(ZOOM);
    else if (what === "whole" && group.whole) setRange(group, ...group.whole);
    else if (what === "whole")
      document.dispatchEvent(new CustomEvent("rpud-whole", { detail: { group: group.key } }));
  }

  function showRange(group) {
    const range = currentRange(group);
    if (!range) return;
    const width = range[1] - range[0];
    for (const bar of group.controls) {
      const text = bar.querySelector(".plot-range");
      if (text) text.textContent =
        `${time(range[0], width)} to ${time(range[1], width)} ${group.unit}`.trimEnd();
    }
  }

  // --- The cursor. ---

  function setCursor(group, x, spoken) {
    group.cursor = x;
    for (const plot of group.plots) showCursor(plot);
    const range = currentRange(group);
    const width = range ? range[1] - range[0] : 1;
    const near = x === null ? [] : marksAt(group, x);
    let text = "";
    if (x !== null && group.named) {
      text = `at ${time(x, width)} ${group.unit}`.trimEnd();
      if (near.length) text += `: ${near.slice(0, 3).map((mark) => mark.text).join("; ")}`;
      if (near.length > 3) text += `; and ${near.length - 3} more`;
    }
    for (const bar of group.controls) {
      const shown = bar.querySelector(".plot-cursor");
      if (shown) shown.textContent = text;
      const voice = bar.querySelector(".plot-spoken");
      if (voice && spoken) voice.textContent = `${text}. ${spoken}`;
    }
  }

  function marksAt(group, x) {
    const plot = [...group.plots].find((each) => each.visible);
    if (!plot) return [];
    const scale = plot.view.frame.x_scale;
    const place = scale.compute(x);
    return group.marks.filter((mark) => {
      if (mark.kind !== "command") {
        const end = mark.end === null ? Infinity : mark.end;
        if (mark.time <= x && x <= end) return true;
      }
      return Math.abs(scale.compute(mark.time) - place) <= NEAR;
    });
  }

  function showCursor(plot) {
    if (!plot.visible) return;
    placeLine(plot);
    const x = plot.group.cursor;
    for (const [layer, readers] of plot.readers) {
      const output = plot.host.querySelector(`.key[data-layer="${layer}"] output`);
      if (output) output.textContent = x === null ? "" : readers(x);
    }
  }

  function placeLine(plot) {
    const x = plot.group.cursor;
    const frame = plot.view.frame;
    const bbox = frame && frame.bbox;
    if (x === null || !bbox) {
      plot.line.style.visibility = "hidden";
      return;
    }
    const place = frame.x_scale.compute(x);
    const seen = place >= bbox.left && place <= bbox.right;
    plot.line.style.visibility = seen ? "visible" : "hidden";
    plot.line.style.transform = `translate(${place}px, ${bbox.top}px)`;
    plot.line.style.height = `${bbox.height}px`;
  }

  /* Returns a function that gives the text of a layer's values at x. */
  function reader(source, read) {
    return (x) => {
      const data = source.data;
      const get = (name) => (data.get ? data.get(name) : data[name]);
      const xs = get(read.x);
      if (!xs || !xs.length) return "";
      let index = lastAtOrBefore(xs, x);
      if (read.how === "nearest") {
        if (index < 0 || (index + 1 < xs.length && xs[index + 1] - x < x - xs[index])) index += 1;
      } else if (index < 0) return "–";
      if (read.until && x > get(read.until)[index]) return "–";
      const value = get(read.y)[index];
      if (!Number.isFinite(value)) return "–";
      let text = number(value);
      if (read.low && get(read.low)) {
        const [low, high] = [get(read.low)[index], get(read.high)[index]];
        if (low !== high) text += ` (${number(low)} … ${number(high)})`;
      }
      return text;
    };
  }

  function lastAtOrBefore(xs, x) {
    let [low, high] = [0, xs.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (xs[middle] <= x) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  function number(value) {
    if (!Number.isFinite(value)) return "–";
    if (value === 0) return "0";
    const size = Math.abs(value);
    if (size >= 1e6 || size < 1e-4) return value.toExponential(3);
    const text = value.toPrecision(size >= 1e4 ? 6 : 4);
    return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
  }

  function time(value, width) {
    const digits = Math.min(Math.max(Math.ceil(3 - Math.log10(Math.max(width, 1e-9))), 0), 9);
    return value.toFixed(digits);
  }

  // --- One plot. ---

  function attach(view) {
    const model = view.model;
    const host = document.querySelector(`figure.plot[data-plot="${CSS.escape(model.name || "")}"]`);
    if (!host || (plots.has(model.name) && plots.get(model.name).view === view)) return;
    const group = groupOf(host.dataset.group, model.name);
    const area = host.querySelector(".plot-area");
    area.querySelectorAll(".plot-line").forEach((line) => line.remove());
    const line = area.appendChild(document.createElement("div"));
    line.className = "plot-line";
    const plot = {
      view, model, host, group, area, line, visible: isNear(host), stale: false,
      readers: new Map(), logarithmic: /Log/.test(model.x_scale.type || ""),
    };
    plots.set(model.name, plot);
    group.plots.add(plot);
    if (!group.whole && !group.named)
      group.whole = [model.x_range.start, model.x_range.end];
    findReaders(plot);
    paint(plot);
    listen(plot);
    watch.observe(host);
    applyRange(plot);
    showRange(group);
  }

  function tagsOf(model, kind) {
    for (const tag of model.tags || []) {
      if (typeof tag !== "string" || !tag.startsWith("{")) continue;
      try {
        const content = JSON.parse(tag);
        if (kind in content) return content[kind];
      } catch { /* a tag of somebody else */ }
    }
    return null;
  }

  function findReaders(plot) {
    for (const model of plot.model.references()) {
      const read = tagsOf(model, "read");
      if (read) plot.readers.set(read.layer, reader(model, read));
    }
  }

  function paint(plot) {
    if (!colors) {
      const element = document.querySelector("script.plot-theme");
      colors = element ? JSON.parse(element.textContent) : null;
    }
    if (!colors) return;
    const theme = dark.matches ? colors.dark : colors.light;
    for (const model of plot.model.references()) {
      const named = tagsOf(model, "paint");
      if (!named) continue;
      const changes = {};
      for (const [property, name] of Object.entries(named)) {
        const old = model[property];
        const value = theme[name];
        // A glyph's colour is a specification that holds the value.
        if (old && typeof old === "object" && "value" in old) {
          if (old.value !== value) changes[property] = { ...old, value };
        } else if (old !== value) changes[property] = value;
      }
      if (Object.keys(changes).length) model.setv(changes, { sync: false });
    }
  }

  function listen(plot) {
    const { area, group, model } = plot;
    model.x_range.change.connect(() => {
      const { start, end } = model.x_range;
      if (plot.stale || !Number.isFinite(start) || !Number.isFinite(end)) return;
      const range = group.range;
      if (range && range[0] === start && range[1] === end) return;
      if (group.plots.size > 1 || group.controls.length) setRange(group, start, end);
      else group.range = [start, end];
      placeLine(plot);
    });
    area.addEventListener("pointermove", (event) => follow(plot, event));
    area.addEventListener("pointerdown", (event) => follow(plot, event));
    area.addEventListener("pointerleave", (event) => {
      if (event.pointerType === "mouse") setCursor(group, null);
    });
    area.addEventListener("dblclick", () => act(group, "whole"));
    area.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return; // the wheel alone scrolls the page
      event.preventDefault();
      act(group, event.deltaY < 0 ? "in" : "out", timeAt(plot, event));
    }, { passive: false });
    area.addEventListener("keydown", (event) => press(plot, event));
    if (coarse.matches) // a finger scrolls the page; the buttons zoom
      for (const tool of model.toolbar.tools) tool.active = false;
    // The area has the focus, not Bokeh's elements in it.
    for (const element of inside(plot.view.el, "[tabindex]")) element.setAttribute("tabindex", "-1");
  }

  function* inside(root, selector) {
    const roots = [root];
    while (roots.length) {
      const next = roots.pop();
      for (const scope of [next, next.shadowRoot]) {
        if (!scope) continue;
        yield* scope.querySelectorAll(selector);
        for (const each of scope.querySelectorAll("*")) if (each.shadowRoot) roots.push(each);
      }
    }
  }

  function timeAt(plot, event) {
    const box = plot.area.getBoundingClientRect();
    const frame = plot.view.frame;
    const place = Math.min(Math.max(event.clientX - box.left, frame.bbox.left), frame.bbox.right);
    return frame.x_scale.invert(place);
  }

  function follow(plot, event) {
    if (plot.view.frame && plot.view.frame.bbox) setCursor(plot.group, timeAt(plot, event));
  }

  function press(plot, event) {
    const { group } = plot;
    if (event.altKey || event.metaKey || event.ctrlKey || event.target !== plot.area) return;
    const acts = { ArrowLeft: "back", ArrowRight: "on", "+": "in", "=": "in", "-": "out",
      "_": "out", Home: "whole" };
    if (event.shiftKey && (event.key === "ArrowLeft" || event.key === "ArrowRight")) {
      const range = currentRange(group);
      const width = range[1] - range[0];
      const from = group.cursor === null ? range[0] + width / 2 : group.cursor;
      const to = from + (event.key === "ArrowLeft" ? -1 : 1) * width / 100;
      const x = Math.min(Math.max(to, range[0]), range[1]);
      setCursor(group, x, speech(plot, x));
    } else if (event.key === "Escape") setCursor(group, null);
    else if (event.key in acts) act(group, acts[event.key]);
    else return;
    event.preventDefault();
  }

  function speech(plot, x) {
    const said = [plot.host.querySelector(".plot-title").textContent];
    for (const [layer, read] of plot.readers) {
      const key = plot.host.querySelector(`.key[data-layer="${layer}"]`);
      if (key) said.push(`${key.firstChild.nextSibling.textContent.trim()} ${read(x)}`);
    }
    return said.join(", ");
  }

  // --- When plots are drawn. ---

  function isNear(host) {
    const box = host.getBoundingClientRect();
    return box.bottom > -400 && box.top < window.innerHeight + 400;
  }

  const watch = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      const plot = plots.get(entry.target.dataset.plot);
      if (!plot) {
        if (entry.isIntersecting) void drawFile(entry.target);
        continue;
      }
      plot.visible = entry.isIntersecting;
      if (plot.visible) {
        if (plot.stale) applyRange(plot);
        showCursor(plot);
      }
    }
  }, { rootMargin: "400px" });

  const begun = new Map();

  /* Draws a plot of a file from the data in the page. */
  function drawFile(host) {
    const name = host.dataset.plot;
    if (!begun.has(name)) {
      const element = document.querySelector(`script.plot-data[data-name="${CSS.escape(name)}"]`);
      begun.set(name, element ? embed(host, JSON.parse(element.textContent)) : Promise.resolve());
    }
    return begun.get(name);
  }

  async function embed(host, item) {
    const views = await Bokeh.embed.embed_item(item, host.querySelector(".plot-drawing"));
    for (const view of views.roots) attach(view);
  }

  /* Finds plots that a server has drawn. */
  function attachAll() {
    if (!window.Bokeh) return;
    const views = [...Bokeh.index];
    while (views.length) {
      const view = views.pop();
      if (view.frame && view.frame.bbox) attach(view);
      else views.push(...(view.child_views || []));
    }
  }

  function setMarks(key, marks) {
    groupOf(key, key).marks = marks;
  }

  dark.addEventListener("change", () => plots.forEach(paint));
  window.addEventListener("resize", () => plots.forEach(placeLine));
  for (const bar of document.querySelectorAll(".plot-controls"))
    groupOf(bar.dataset.group, bar.dataset.group);
  const hosts = [...document.querySelectorAll("figure.plot")];
  const ofFile = (host) =>
    document.querySelector(`script.plot-data[data-name="${CSS.escape(host.dataset.plot)}"]`);
  for (const host of hosts) if (ofFile(host)) watch.observe(host);
  const drawAll = () => Promise.all(hosts.filter(ofFile).map(drawFile));
  window.addEventListener("beforeprint", drawAll);
  if (!hosts.every(ofFile)) {
    const timer = setInterval(() => {
      attachAll();
      if (hosts.every((host) => ofFile(host) || plots.has(host.dataset.plot))) clearInterval(timer);
    }, 100);
  }
  return { attachAll, attach, drawAll, act, setRange, setCursor, setMarks, plots, groups };
})();
