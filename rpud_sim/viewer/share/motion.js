// @ts-check
/* Zigzag of the free mass between tip and tool, over the same 20 ms and at the same place as the section. */
import { make } from "./dom.js";
import { quantityOf, roundUp, valueText } from "./quantities.js";

const MOTION_LEFT = 52, MOTION_RIGHT = 10, MOTION_TOP = 6, MOTION_FORCES = 34, MOTION_BOTTOM = 18; // px
const MOTION_LINES = /** @type {const} */ ([["actuator", "tip", "plane"], ["free_mass", "free mass", "mass"], ["drill_tool", "drill tool", "tool"]]);

/** Multiples of a round step within a range. @param {number} low @param {number} high @param {number} count of them, about */
export function motionTicks(low, high, count) {
  const every = roundUp((high - low) / Math.max(count, 1)), ticks = [];
  for (let each = Math.ceil(low / every); each * every <= high; each += 1) ticks.push(+(each * every).toPrecision(9));
  return ticks;
}

/** Middle of each contact [s]. @param {import("./frames.js").Section} block */
const motionStruck = (block) => block.impacts.map(([time, , length]) => time + (length || 0) / 2);

/** Draw the motion of the bodies into a figure. @param {HTMLElement} element @param {import("./clock.js").MotionClock} clock */
export function mountMotion(element, clock) {
  const canvas = make("canvas", { ariaHidden: "true" });
  const area = make("div", { className: "area", tabIndex: 0, role: "slider", ariaLabel: "place in the motion of the last 20 ms", ariaValueMax: "0" });
  const cursor = make("div", { className: "cursor" }), dot = make("i"), title = make("figcaption"), unit = make("small");
  const outputs = MOTION_LINES.map(([, label, colour]) => {
    const entry = make("span", { className: "key" }), output = make("output");
    entry.style.setProperty("--of", `var(--${colour})`);
    entry.append(make("span", { textContent: label }), output);
    title.append(entry);
    return output;
  });
  title.prepend(make("b", { textContent: "motion of the last 20 ms" }), unit);
  cursor.append(dot);
  area.append(canvas, cursor);
  element.classList.add("plot", "motion");
  element.replaceChildren(title, area);
  let width = 0, height = 0, low = 0, high = 1, told = -1e9;

  const x = (/** @type {number} */ place) => MOTION_LEFT + (clock.end ? place / clock.end : 0) * (width - MOTION_LEFT - MOTION_RIGHT);
  // Toward the rock is down, as in the section.
  const y = (/** @type {number} */ position) =>
    MOTION_TOP + ((position - low) / (high - low)) * (height - MOTION_BOTTOM - MOTION_FORCES - MOTION_TOP);

  function draw() {
    const context = canvas.getContext("2d"), block = clock.block;
    if (!context || !width || !height) return;
    const style = getComputedStyle(element), colour = (/** @type {string} */ name) => style.getPropertyValue(`--${name}`).trim() || style.color;
    const right = width - MOTION_RIGHT, base = height - MOTION_BOTTOM, { scale, unit: name } = quantityOf("free_mass");
    [canvas.width, canvas.height] = [width, height].map((each) => Math.round(each * devicePixelRatio));
    context.scale(devicePixelRatio, devicePixelRatio);
    Object.assign(context, { font: `12px ${style.fontFamily}`, textBaseline: "middle", lineJoin: "round" });
    const write = (/** @type {string} */ text, /** @type {number} */ left, /** @type {number} */ top, /** @type {CanvasTextAlign} */ align) => {
      context.textAlign = align;
      context.fillText(text.replace("-", "\u2212"), left, top);
    };
    unit.textContent = name;
    context.fillStyle = style.color;
    if (!block) return write("no waveform yet", width / 2, height / 2, "center");
    [low, high] = [Infinity, -Infinity];
    for (const [body] of MOTION_LINES) for (const value of block[body]) {
      low = value < low ? value : low;
      high = value > high ? value : high;
    }
    const margin = Math.max(0.04 * (high - low), 2e-6);
    [low, high] = [low - margin, high + margin];

    context.strokeStyle = colour("rule");
    context.fillStyle = colour("muted");
    context.beginPath();
    for (const tick of motionTicks(low * scale, high * scale, (base - MOTION_FORCES) / 30)) {
      context.moveTo(MOTION_LEFT, y(tick / scale));
      context.lineTo(right, y(tick / scale));
      write(`${tick}`, MOTION_LEFT - 6, y(tick / scale), "right");
    }
    for (const tick of motionTicks(-clock.end * 1e3 - 0.1, 0, width / 100)) {
      const place = Math.max(x(clock.end + tick / 1e3), MOTION_LEFT);
      context.moveTo(place, MOTION_TOP);
      context.lineTo(place, base);
      write(tick ? `${tick}` : "0 ms", tick ? place : right, height - MOTION_BOTTOM / 2, tick ? "center" : "right");
    }
    context.stroke();
    if (block.impacts.length) write("kN", MOTION_LEFT - 6, base - 6, "right");

    const count = block.free_mass.length;
    for (const [body, , paint] of MOTION_LINES) {
      // Least and greatest of each column, as one shape; one of the tip holds a whole vibration.
      const columns = Math.max(Math.min(Math.round(right - MOTION_LEFT), Math.ceil(body === "actuator" ? count / 4 : count)), 1);
      /** @type {[number, number][]} */ let lows = [];
      Object.assign(context, { strokeStyle: colour(paint), fillStyle: `color-mix(in srgb, ${colour(paint)} 40%, transparent)`,
        lineWidth: body === "free_mass" ? 1.6 : 1.2 });
      for (let each = 0; each <= columns; each += 1) {
        const first = Math.floor((each * count) / columns), last = Math.min(Math.floor(((each + 1) * count) / columns), count - 1);
        const part = block[body].subarray(first, last + 1), place = x(((first + last) / 2) * block.period);
        if (!lows.length) context.beginPath();
        if (part.length && part.every(Number.isFinite)) {
          context.lineTo(place, y(Math.max(...part)));
          lows.push([place, y(Math.min(...part))]);
          continue;
        }
        for (const [before, value] of lows.reverse()) context.lineTo(before, value);
        context.closePath();
        context.fill();
        context.stroke();
        lows = [];
      }
    }

    const strongest = Math.max(...block.impacts.map(([, peak]) => peak || 0), 1), struck = motionStruck(block);
    let free = MOTION_LEFT - 2;
    context.fillStyle = colour("force");
    block.impacts.forEach(([time, peak], each) => {
      const place = x(struck[each]), top = base - (peak / strongest) * (MOTION_FORCES - 16);
      context.fillRect(place - 1, top, 2, base - top);
      context.beginPath();
      context.arc(place, y(block.drill_tool[Math.min(Math.round(time / block.period), count - 1)]), 2.5, 0, 7);
      context.fill();
      const text = peak ? (peak / 1e3)[peak < 50 ? "toPrecision" : "toFixed"](1) : "", half = context.measureText(text).width / 2;
      const middle = Math.min(Math.max(place, MOTION_LEFT + half), right - half);
      if (middle - half < free) return;
      write(text, middle, top - 7, "center");
      free = middle + half + 3;
    });
  }

  function move() {
    const block = clock.block, now = performance.now(), sample = clock.sample;
    cursor.hidden = !block;
    for (const output of block ? [] : outputs) output.textContent = "";
    if (!block) return void (area.ariaValueText = "no waveform yet");
    cursor.style.transform = `translateX(${x(clock.place)}px)`;
    dot.style.transform = `translateY(${y(block.free_mass[sample])}px)`;
    const stands = clock.held || clock.resting, before = (clock.place - clock.end) * 1e3;
    if (now - told < 1000 && !stands && !outputs[0].textContent) return;
    told = now;
    MOTION_LINES.forEach(([body], each) => { outputs[each].textContent = stands ? valueText(body, block[body][sample]) : ""; });
    area.ariaValueMin = (-clock.end * 1e3).toFixed(1);
    area.ariaValueNow = before.toFixed(2);
    area.ariaValueText = `${(-before).toFixed(1)} ms before the newest: free mass at ${valueText("free_mass", block.free_mass[sample])}`;
  }

  for (const kind of /** @type {const} */ (["pointerdown", "pointermove"])) area.addEventListener(kind, (event) => {
    if (!clock.block || (kind === "pointerdown" ? event.button : !area.hasPointerCapture(event.pointerId))) return;
    area.setPointerCapture(event.pointerId);
    clock.still(((event.clientX - area.getBoundingClientRect().left - MOTION_LEFT) / (width - MOTION_LEFT - MOTION_RIGHT)) * clock.end);
  });
  area.addEventListener("keydown", (event) => {
    if (!clock.block || event.ctrlKey || event.altKey || event.metaKey) return;
    const struck = motionStruck(clock.block);
    /** @type {Record<string, number | undefined>} */
    const places = {
      ArrowLeft: clock.place - 1e-4, ArrowRight: clock.place + 1e-4, Home: 0, End: clock.end,
      PageUp: struck.filter((time) => time < clock.place - 1e-6).pop(), PageDown: struck.find((time) => time > clock.place + 1e-6),
    };
    if (event.key === " ") clock.toggle();
    else if (event.key in places) clock.still(places[event.key] ?? clock.place);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });

  new ResizeObserver(() => {
    ({ width, height } = area.getBoundingClientRect());
    draw();
    move();
  }).observe(area);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  clock.listen((changed) => {
    if (changed) draw();
    move();
  });
}
