// @ts-check
/* Section of the drill in slow motion. Bodies are a scheme; one factor magnifies all motions, and another
 * one what goes below the place of touch. Both apply to every body, so that bodies touch in the picture
 * where they touch in the data, and nowhere else. */

import { motionTicks } from "./motion.js";

/** @typedef {import("./clock.js").MotionClock} Clock */
/** @typedef {{from: number, to: number | null, name: string, colour: number}} Stratum */
/** @typedef {{depth: number | null, layers?: Stratum[],
 *   log?: {depth: ArrayLike<number>, rate: ArrayLike<number>, torque: ArrayLike<number>}}} Hole */

const SECTION_PIXEL = 0.0254 / 96; // of CSS [m]
const SECTION_AXIS = 200, SECTION_TOUCH = 366, SECTION_MASS = 34; // px: axis, tip at rest, mass
const SECTION_ROCK = 506, SECTION_BOTTOM = 712, SECTION_LEFT = 72; // px: rock
const SECTION_PLANE = 262; // nodal plane at rest [px]
const SECTION_UP = 132, SECTION_DOWN = 200, SECTION_STEP = 18; // room of motions, of the tool's step
const SECTION_FACTORS = [1, 2, 3, 5, 10, 20, 30, 50, 100, 200, 500, 1000, 2000, 5000, 10000];
const SECTION_LENGTHS = [1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2];
const SECTION_FLASH = 0.4, SECTION_CHIPS = 0.7; // s that an impact is seen

/** @param {number} length [m] */
const sectionLength = (length) =>
  length >= 1e-3 ? `${+(length * 1e3).toPrecision(3)} mm` : `${+(length * 1e6).toPrecision(3)} µm`;

/** Least of 1, 1.2, 1.5, 2 ... times a power of ten that is not below a value. @param {number} value */
function sectionNice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * ([1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8].find((each) => each * power >= value) ?? 10);
}

function sectionDrawing() {
  const x = SECTION_AXIS;
  let near = "M0 0H9", far = "M9 0";
  for (let turn = 0; turn < 10; turn += 1) {
    far += `L-11 ${turn * 10 + 4}`;
    near += `M-11 ${turn * 10 + 4}L${turn === 9 ? "9 100H0" : `11 ${turn * 10 + 10}`}`;
    far += `M11 ${turn * 10 + 10}`;
  }
  const spring = (/** @type {number} */ at) => `<g transform="translate(${at} 26)">
    <path data-part="spring" class="coil far" d="${far}"/><path data-part="spring" class="coil" d="${near}"/></g>`;
  const horn = [];
  for (let y = 0; y <= 62; y += 2) horn.push([33 * Math.exp(-y / 62 * Math.log(33 / 13)), 12 + y]);
  const outline = [...horn.map(([r, y]) => `${x - r} ${y}`), `${x - 13} 84 ${x + 13} 84`,
    ...horn.reverse().map(([r, y]) => `${x + r} ${y}`)].join(" ");
  const shade = (/** @type {string} */ body) => `<linearGradient id="shade-${body}" class="${body}">
    <stop class="dim" offset="0"/><stop class="lit" offset=".38"/><stop class="dim" offset="1"/></linearGradient>`;
  const rock = [ // lithology: dots, lines, bricks, dashes, crosses, wedges
    "M3 4h.01M11 9h.01M6 13h.01M14 2h.01", "M-2 18L18 -2M-2 2L2 -2M14 18L18 14", "M0 .5H16M0 8.5H16M4 0V8M12 8V16",
    "M2 4H8M9 12H15", "M4 2V6M2 4H6M12 10V14M10 12H14", "M2 6L4 2L6 6M10 14L12 10L14 14"]
    .map((d, each) => `<pattern id="rock-${each}" width="16" height="16" patternUnits="userSpaceOnUse">
      <path d="${d}"/></pattern>`).join("");
  const ring = (/** @type {number} */ y) => `<rect class="crystal" x="${x - 25}" y="${y}" width="50" height="11"/>
    <path class="electrode" d="M${x - 29} ${y + 12.5}H${x + 25}"/>`;
  const label = (/** @type {number} */ y, /** @type {string} */ text, /** @type {number} */ from, part = "") =>
    `<path class="leader" d="M${from} ${y}H346"/><text data-part="${part}" x="352" y="${y + 4}">${text}</text>`;
  return `<defs>${shade("plane")}${shade("mass")}${shade("tool")}${rock}
    <pattern id="rubble" width="9" height="7" patternUnits="userSpaceOnUse"><path d="M1 2l2 -1l1 2ZM6 5l2 -1v2Z"/></pattern>
    <pattern id="cut" width="6" height="6" patternUnits="userSpaceOnUse"><path d="M-1 7L7 -1M-1 1L1 -1M5 7L7 5"/></pattern>
    <radialGradient id="glow"><stop offset="0"/><stop offset="1" stop-opacity="0"/></radialGradient></defs>
  <g class="all"><g data-part="ground"></g><g data-part="log"></g>
  <path class="rail" d="M${x - 104} 26V352M${x + 104} 26V352"/>
  <path class="fixed" d="M${x - 116} 12H${x + 116}V26H${x - 116}Z"/><path class="line" d="M${x - 116} 26H${x + 116}"/>
  ${spring(x - 74)}${spring(x + 74)}${label(19, "load unit", x + 116)}${label(52, "load spring", x + 86)}
  <g data-part="tool" class="tool"><rect data-part="shank" x="${x - 13}" y="17" width="26"/>
    <path d="M${x - 28} 4Q${x - 28} 0 ${x - 24} 0H${x + 24}Q${x + 28} 0 ${x + 28} 4V17H${x - 28}Z"/>
    <path class="break" d="M${x - 16} 34q8 -7 16 0t16 0v6q-8 7 -16 0t-16 0Z"/>
    <path class="edge" d="M${x - 16} 34q8 -7 16 0t16 0M${x - 16} 40q8 -7 16 0t16 0"/>
    <g data-part="bit"><path d="M${x - 13} -34L${x - 20} -20V-7L${x - 13} 0L${x - 6} -5L${x} 0L${x + 6} -5L${x + 13} 0L${x + 20} -7V-20L${x + 13} -34Z"/>
      <path class="edge" d="M${x - 20} -18L${x + 20} -12M${x - 20} -12L${x + 20} -6"/></g></g>
  <g class="plane"><g data-part="tip"><rect x="${x - 13}" y="-58" width="26" height="58"/></g></g>
  <g data-part="plane" class="plane">
    <path d="M${x - 31} -106Q${x - 31} -110 ${x - 27} -110H${x + 27}Q${x + 31} -110 ${x + 31} -106V-66H${x - 31}Z"/>
    <rect x="${x - 8}" y="-118" width="16" height="8"/>${[-64, -50.5, -37, -23.5].map(ring).join("")}
    <path class="lead" d="M${x - 29} -51.5H${x - 40}V-114M${x - 29} -24.5H${x - 45}V-114"/>
    <path d="M${x - 33} -10H${x + 33}V12H${x - 33}Z"/><polygon points="${outline}"/>
    <path d="M${x - 100} -5H${x + 100}V5H${x - 100}Z"/>
    <path d="M${x - 112} -13H${x - 96}V13H${x - 112}ZM${x + 96} -13H${x + 112}V13H${x + 96}Z"/>
    ${label(-44, "piezo stack", x + 25)}${label(0, "nodal plane", x + 112)}${label(48, "horn", x + 18)}
    ${label(88, "tip", x + 13, "tip-text")}</g>
  <g data-part="mass" class="mass"><rect x="${x - 34}" width="68" height="${SECTION_MASS}" rx="3"/>
    <rect class="cut" x="${x - 34}" width="68" height="${SECTION_MASS}" rx="3"/></g>
  <path class="axis" d="M${x} 4V${SECTION_BOTTOM}"/>
  <path data-part="mass-line" class="leader"/><text x="352" y="388">free mass</text>
  <path data-part="tool-line" class="leader"/><text x="352" y="424">drill tool</text>
  <text data-part="step-text" class="muted" x="352" y="441"></text>
  <g data-part="flash" class="force" opacity="0"><ellipse cx="${x}" rx="74" ry="15"/>
    <text data-part="force" class="big" x="${x - 46}" y="6" text-anchor="end"></text></g>
  <path data-part="chips" class="chips" d=""/>
  <g class="scale"><path class="line" data-part="bar"/><text data-part="bar-text" x="28"></text></g>
  <text class="muted air" x="${x}" y="706" text-anchor="middle">not in the rock</text></g>
  <text class="none" x="${x}" y="620" text-anchor="middle">no waveform yet</text>`;
}

/**
 * Draw the section of the drill into an element, with its legend and its slow-motion control.
 * @param {HTMLElement} element @param {Clock} clock
 */
export function mountSection(element, clock) {
  element.classList.add("section");
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 540 720");
  svg.setAttribute("role", "img");
  svg.innerHTML = sectionDrawing();
  const legend = document.createElement("p"), factors = document.createElement("span");
  const speed = document.createElement("select"), hold = document.createElement("button");
  const pace = document.createElement("span");
  pace.className = "pace";
  for (const each of [1, 2, 5, 20]) speed.add(new Option(`${each} ms`, String(each), each === clock.speed, each === clock.speed));
  speed.setAttribute("aria-label", "motion that a second shows");
  speed.addEventListener("change", () => { clock.speed = Number(speed.value); });
  hold.type = "button";
  hold.addEventListener("click", () => clock.toggle());
  pace.append("1 s shows ", speed, " ", hold, " ");
  legend.append(pace, factors);
  element.replaceChildren(svg, legend);

  /** @type {Record<string, SVGElement[]>} */ const parts = {};
  for (const part of svg.querySelectorAll("[data-part]"))
    (parts[/** @type {SVGElement} */ (part).dataset.part ?? ""] ??= []).push(/** @type {SVGElement} */ (part));
  const set = (/** @type {string} */ part, /** @type {Record<string, string | number>} */ values) => {
    for (const each of parts[part]) for (const name in values) each.setAttribute(name, String(values[name]));
  };
  const write = (/** @type {string} */ part, /** @type {string} */ text) => { parts[part][0].textContent = text; };
  const make = (/** @type {string} */ name, /** @type {Record<string, string | number>} */ values, text = "") => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const each in values) made.setAttribute(each, String(values[each]));
    made.textContent = text;
    return made;
  };

  let ratio = 1; // CSS pixels to a unit of the drawing
  let factor = 0, stepFactor = 0; // magnification of motions, and of those below the place of touch
  let crushed = 0; // how far the bit goes into the crushed rock [units]
  let bottom = SECTION_ROCK; // of the hole [units]
  let inRock = true, told = -1e9;
  /** @type {Hole | null} */ let hole = null;
  let regime = "", drawn = "";

  const units = (/** @type {number} */ position) =>
    (position * (position > 0 ? stepFactor : factor)) / SECTION_PIXEL / ratio;

  function scale() {
    let up = 0, down = 0;
    const block = clock.block;
    if (block) for (const values of [block.nodal_plane, block.actuator, block.free_mass, block.drill_tool])
      for (const value of values) {
        if (-value > up) up = -value;
        if (value > down) down = value;
      }
    const greatest = (/** @type {number} */ motion, /** @type {number} */ room) =>
      SECTION_FACTORS.filter((each) => (motion * each) / SECTION_PIXEL / ratio <= room).pop() ?? 1;
    // A tool that moves farther than any rock yields hangs free.
    inRock = regime !== "free" && down < 1e-3;
    const kept = (/** @type {number} */ now, /** @type {number} */ best) => (now <= best && now * 4 > best ? now : best);
    if (up > 1e-6 || !factor) factor = up > 1e-6 ? kept(factor, greatest(up, SECTION_UP)) : 5;
    if (inRock) stepFactor = kept(stepFactor, greatest(Math.max(down, 2e-5), SECTION_STEP));
    factor = Math.min(factor, inRock ? stepFactor : greatest(down, SECTION_DOWN));
    if (!inRock) stepFactor = factor;
    element.classList.toggle("free", !inRock);
    crushed = inRock ? units(down) : 0;
    const length = SECTION_LENGTHS.filter((each) => -units(-each) <= 90).pop() ?? 1e-6;
    set("bar", { d: `M14 ${SECTION_TOUCH}H22M18 ${SECTION_TOUCH}V${SECTION_TOUCH + units(-length)}M14 ${SECTION_TOUCH + units(-length)}H22` });
    set("bar-text", { y: SECTION_TOUCH + units(-length) / 2 + 4 });
    write("bar-text", sectionLength(length));
    factors.textContent = `motion ${factor} times its size` + (stepFactor > factor ? `, the tool's step ${stepFactor} times` : "");
    write("step-text", block && stepFactor > factor ? `step ×${stepFactor}: ${sectionLength(+down.toPrecision(2))}` : "");
    if (block) {
      let vibration = 0;
      block.actuator.forEach((tip, each) => { vibration = Math.max(vibration, Math.abs(tip - block.nodal_plane[each])); });
      write("tip-text", vibration > 1e-7 ? `tip, vibrates ±${sectionLength(+vibration.toPrecision(2))}` : "tip");
    }
    ground();
  }

  function ground() {
    const depth = hole?.depth, known = typeof depth === "number" && Number.isFinite(depth);
    const state = JSON.stringify([depth, hole?.layers, hole?.log?.depth.length, inRock, crushed]);
    if (state === drawn) return;
    drawn = state;
    const layers = hole?.layers?.length ? hole.layers : [{ from: 0, to: null, name: "rock", colour: 3 }];
    const deep = known ? depth : 0, height = SECTION_BOTTOM - SECTION_ROCK;
    const boundary = layers.find((each) => each.from > deep)?.from ?? 0;
    const shown = sectionNice(Math.max(1.3 * deep, Math.min(1.15 * boundary, 10 * Math.max(deep, 2e-3)), 2e-3));
    const at = (/** @type {number} */ value) => SECTION_ROCK + (Math.min(value, shown) / shown) * height;
    const log = hole?.log?.depth.length && known ? hole.log : null;
    const right = log ? 336 : 526;
    const drawing = [], x = SECTION_AXIS;
    bottom = inRock ? at(deep) : SECTION_ROCK;
    if (inRock) {
      for (const layer of layers.filter((each) => each.from < shown)) {
        const top = at(layer.from), end = at(layer.to ?? shown);
        const box = { x: SECTION_LEFT, y: top, width: right - SECTION_LEFT, height: Math.max(end - top, 0) };
        drawing.push(make("rect", { ...box, class: `stratum stratum-${layer.colour % 6}` }),
          make("rect", { ...box, fill: `url(#rock-${layer.colour % 6})` }));
        if (end - top > 15) drawing.push(make("text", { class: deep >= layer.from && deep < (layer.to ?? Infinity) ? "halo now" : "halo",
          x: right - 8, y: Math.min(top + 17, end - 3), "text-anchor": "end" }, layer.name));
        if (layer.from > 0) drawing.push(make("path", { class: "line", d: `M${SECTION_LEFT} ${top}H${right}` }));
      }
      drawing.push(make("rect", { class: "hole", x: x - 23, y: SECTION_ROCK - 1, width: 46, height: bottom - SECTION_ROCK + crushed + 5 }),
        make("path", { class: "crushed", d: `M${x - 23} ${bottom}H${x + 23}V${bottom + crushed + 4}H${x - 23}Z` }),
        make("path", { fill: "url(#rubble)", d: `M${x - 23} ${bottom}H${x + 23}V${bottom + crushed + 4}H${x - 23}Z` }),
        make("path", { class: "edge", d: `M${SECTION_LEFT} ${SECTION_ROCK}H${x - 23}V${bottom + crushed + 4}H${x + 23}V${SECTION_ROCK}H${right}` }));
    }
    if (inRock && known) {
      drawing.push(make("path", { class: "line", d: `M${SECTION_LEFT - 6} ${SECTION_ROCK}V${SECTION_BOTTOM}` }));
      for (const tick of motionTicks(0, shown * 1.001, 5)) {
        drawing.push(make("path", { class: "line", d: `M${SECTION_LEFT - 11} ${at(tick)}H${SECTION_LEFT - 6}` }));
        if (Math.abs(at(tick) - bottom) > 13 && tick > 0) drawing.push(make("text", { class: "muted", x: SECTION_LEFT - 14, y: at(tick) + 4, "text-anchor": "end" }, String(+(tick * 1e3).toPrecision(3))));
      }
      drawing.push(make("path", { class: "mark", d: `M${SECTION_LEFT - 6} ${bottom}l-8 -5v10Z` }),
        make("text", { class: "now", x: SECTION_LEFT - 17, y: bottom + 4, "text-anchor": "end" }, String(+(deep * 1e3).toPrecision(3))),
        make("text", { class: "muted", x: 8, y: SECTION_ROCK - 14 }, "depth, mm"));
    }
    parts.ground[0].replaceChildren(...drawing);
    parts.log[0].replaceChildren(...(log && inRock ? [...track(log.depth, log.rate, 6e4, "mm/min", "rate", 352, at),
      ...track(log.depth, log.torque, 1, "N m", "torque", 448, at)] : []));
    set("shank", { height: bottom - SECTION_TOUCH - SECTION_MASS - 17 - 20 });
    set("bit", { transform: `translate(0 ${bottom - SECTION_TOUCH - SECTION_MASS})` });
    picture();
  }

  /** @param {ArrayLike<number>} depths @param {ArrayLike<number>} values @param {number} unit
   * @param {string} kind @param {number} left @param {(depth: number) => number} at */
  function track(depths, values, scale, unit, kind, left, at) {
    const width = 78, shown = Array.from(values, (value) => value * scale);
    const most = sectionNice(Math.max(...shown.filter(Number.isFinite), 1e-3));
    let line = "";
    shown.forEach((value, each) => {
      if (Number.isFinite(value)) line += `${line ? "L" : "M"}${(left + (Math.max(value, 0) / most) * width).toFixed(1)} ${at(depths[each]).toFixed(1)}`;
    });
    return [make("path", { class: "grid", d: `M${left} ${SECTION_ROCK}V${SECTION_BOTTOM}M${left + width / 2} ${SECTION_ROCK}V${SECTION_BOTTOM}M${left + width} ${SECTION_ROCK}V${SECTION_BOTTOM}` }),
      make("path", { class: "line", d: `M${left} ${SECTION_ROCK}H${left + width}` }),
      make("path", { class: `curve ${kind}`, d: line }),
      make("text", { class: kind, x: left, y: SECTION_ROCK - 24 }, kind),
      make("text", { class: "muted", x: left + width, y: SECTION_ROCK - 6, "text-anchor": "end" }, `${+most.toPrecision(3)} ${unit}`)];
  }

  function picture() {
    const block = clock.block, sample = clock.sample;
    const of = (/** @type {Float32Array | undefined} */ values) => units(values?.[sample] ?? 0);
    const plane = block ? (block.nodal_plane[sample] * factor) / SECTION_PIXEL / ratio : 0;
    const mass = SECTION_TOUCH + of(block?.free_mass), tool = SECTION_TOUCH + SECTION_MASS + of(block?.drill_tool);
    set("plane", { transform: `translate(0 ${SECTION_PLANE + plane})` });
    set("spring", { transform: `scale(1 ${(SECTION_PLANE - 31 + plane) / 100})` });
    set("tip", { transform: `translate(0 ${SECTION_TOUCH + of(block?.actuator)})` });
    set("mass", { transform: `translate(0 ${mass})` });
    set("tool", { transform: `translate(0 ${tool})` });
    set("mass-line", { d: `M${SECTION_AXIS + 34} ${mass + SECTION_MASS / 2}L330 384H346` });
    set("tool-line", { d: `M${SECTION_AXIS + 28} ${tool + 10}L330 420H346` });
    impacts(tool);
  }

  /** Flash and chips of the latest impacts. @param {number} tool place of its upper face */
  function impacts(tool) {
    let flash = 0, chips = "";
    for (const [time, force, length] of clock.block?.impacts ?? []) {
      const age = ((clock.place - time) * 1e3) / clock.speed + clock.rest;
      if (age < 0 || clock.place < time || age > SECTION_CHIPS) continue;
      if (age < SECTION_FLASH) {
        flash = 1 - age / SECTION_FLASH;
        write("force", `${(force / 1e3).toFixed(2)} kN`);
      }
      if (!inRock || !length) continue;
      for (let chip = 0; chip < 8; chip += 1) {
        // The same chips at each show of the same impact.
        const chance = Math.abs(Math.sin(time * 1e5 + chip * 12.9898) * 43758.5453) % 1, side = chip % 2 ? 1 : -1;
        const across = SECTION_AXIS + side * (21 + (30 + 95 * chance) * age);
        const above = SECTION_ROCK - 3 - (90 + 150 * ((chance * 7) % 1)) * age + 420 * age * age;
        const size = 1.6 + 2.4 * ((chance * 13) % 1);
        if (above < SECTION_ROCK - 2) chips += `M${across.toFixed(1)} ${above.toFixed(1)}l${size} ${-size * 0.6}l${size * 0.7} ${size}Z`;
      }
    }
    set("flash", { opacity: flash.toFixed(2), transform: `translate(0 ${tool})` });
    set("chips", { d: chips });
  }

  function tell() {
    const now = performance.now(), block = clock.block;
    if (block && now - told < 1000) return; // nobody can hear a text that changes faster
    told = block ? now : -1e9;
    const at = (/** @type {Float32Array} */ values) => sectionLength(values[clock.sample]);
    svg.setAttribute("aria-label", !block ? "Section of the drill: no waveform yet."
      : `Section of the drill at ${(block.time + clock.place).toFixed(4)} s. Nodal plane at ${at(block.nodal_plane)}, `
        + `free mass at ${at(block.free_mass)}, drill tool at ${at(block.drill_tool)}; ${block.impacts.length} impacts in 20 ms.`
        + (typeof hole?.depth === "number" ? ` The hole is ${sectionLength(hole.depth)} deep.` : ""));
  }

  new ResizeObserver(() => {
    const box = svg.getBoundingClientRect();
    ratio = Math.min(box.width / 540, box.height / 720) || 1;
    element.classList.toggle("small", ratio < 0.8);
    scale();
  }).observe(svg);
  clock.listen((changed) => {
    element.classList.toggle("empty", !clock.block);
    hold.textContent = clock.held ? "play" : clock.resting ? "replay" : "hold";
    if (changed) scale();
    picture();
    tell();
  });

  return {
    /** Show the hole. @param {Hole | null | undefined} value */
    setHole(value) { hole = value ?? null; ground(); },
    /** Show the drill in the rock, or before it. @param {string} value `free` or `drilling` */
    setRegime(value) { if (value !== regime) { regime = value; scale(); } },
  };
}
