// @ts-check
/* Section of the drill in slow motion. Bodies are a scheme; one factor magnifies all motions, and another
 * one what goes below the place of touch. Both apply to every body, so that bodies touch in the picture
 * where they touch in the data, and nowhere else. */
import { roundUp, valueText } from "./quantities.js";

/** A hole's `tip` is where an arm has put the bit, as a depth [m].
 * @typedef {{from: number, to: number | null, name: string, colour: number}} Stratum
 * @typedef {{depth: number | null, tip?: number | null, layers?: Stratum[],
 *   log?: {depth: ArrayLike<number>, rate: ArrayLike<number>, torque: ArrayLike<number>}}} Hole */

const SECTION_PIXEL = 0.0254 / 96; // of CSS [m]
const SECTION_AXIS = 200, SECTION_PLANE = 262, SECTION_TOUCH = 366, SECTION_MASS = 34; // places at rest, height
const SECTION_TOOL = SECTION_TOUCH + SECTION_MASS, SECTION_ROCK = 506, SECTION_BOTTOM = 712, SECTION_LEFT = 72;
const SECTION_UP = 114, SECTION_DOWN = 200, SECTION_STEP = 18; // room of motions, of the tool's step in rock
const SECTION_FACTORS = [1, 2, 3, 5, 10, 20, 30, 50, 100, 200, 500, 1000, 2000, 5000];
const SECTION_LENGTHS = [1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2];
const SECTION_BODIES = /** @type {const} */ (["nodal_plane", "actuator", "free_mass", "drill_tool"]);
const SECTION_TRACKS = /** @type {const} */ ([["torque", "N m", 1], ["rate", "mm/min", 6e4]]); // of the well log, right to left
const SECTION_FLASH = 0.4, SECTION_CHIPS = 0.7; // s that an impact is seen
const SECTION_ABOVE = 36; // greatest place of a bit above the face
const SECTION_ROUND = [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8]; // digits of a depth and of a track
const SECTION_LITHOLOGY = [ // dots, lines, bricks, dashes, crosses, wedges
  "M3 4h.01M11 9h.01M6 13h.01M14 2h.01", "M-2 18L18 -2M-2 2L2 -2M14 18L18 14", "M0 .5H16M0 8.5H16M4 0V8M12 8V16",
  "M2 4H8M9 12H15", "M4 2V6M2 4H6M12 10V14M10 12H14", "M2 6L4 2L6 6M10 14L12 10L14 14"];

const sectionLength = (/** @type {number} */ length, digits = 3) => Math.abs(length) >= 1e-3
  ? `${+(length * 1e3).toPrecision(digits)} mm` : `${+(length * 1e6).toPrecision(digits)} µm`;

/** Multiples of a round step from zero on. @param {number} end @param {number} count of them, about */
function sectionTicks(end, count) {
  const every = roundUp(end / count);
  return Array.from({ length: Math.floor(end / every) + 1 }, (_, each) => each * every);
}

/** The drawing, before anything moves. */
function sectionDrawing() {
  const x = SECTION_AXIS;
  let near = "M0 0H9", far = "M9 0";
  for (let turn = 4; turn < 100; turn += 10) {
    near += `M-11 ${turn}L${turn > 90 ? "9 100H0" : `11 ${turn + 6}`}`;
    far += `L-11 ${turn}M11 ${turn + 6}`;
  }
  const horn = Array.from({ length: 32 }, (_, each) => [33 * Math.exp((-each / 31) * Math.log(33 / 13)), 12 + 2 * each]);
  const sides = [...horn.map(([r, y]) => [x - r, y]), [x - 13, 84], [x + 13, 84], ...horn.reverse().map(([r, y]) => [x + r, y])];
  const spring = (/** @type {number} */ at) => `<g transform="translate(${at} 26)">
    <path data-part="spring" class="coil far" d="${far}"/><path data-part="spring" class="coil" d="${near}"/></g>`;
  const shade = (/** @type {string} */ body) => `<linearGradient id="shade-${body}" class="${body}">
    <stop class="dim" offset="0"/><stop class="lit" offset=".38"/><stop class="dim" offset="1"/></linearGradient>`;
  const pattern = (/** @type {string} */ id, /** @type {number} */ size, /** @type {string} */ path) =>
    `<pattern id="${id}" width="${size}" height="${size}" patternUnits="userSpaceOnUse"><path d="${path}"/></pattern>`;
  const crystal = (/** @type {number} */ y) => `<rect class="crystal" x="${x - 25}" y="${y}" width="50" height="11"/>
    <path class="electrode" d="M${x - 29} ${y + 12.5}H${x + 25}"/>`;
  const label = (/** @type {number} */ y, /** @type {string} */ text, /** @type {number} */ from, part = "") =>
    `<path class="leader" d="M${x + from} ${y}H346"/><text data-part="${part}" x="352" y="${y + 4}">${text}</text>`;
  const moving = (/** @type {number} */ y, /** @type {string} */ text, /** @type {string} */ part) =>
    `<path data-part="${part}-line" class="leader"/><text x="352" y="${y + 4}">${text}</text>`;
  return `<defs>${shade("plane")}${shade("mass")}${shade("tool")}${pattern("cut", 6, "M-1 7L7 -1M-1 1L1 -1M5 7L7 5")}
    ${pattern("rubble", 8, "M1 2l2 -1l1 2ZM5 6l2 -1v2Z")}${SECTION_LITHOLOGY.map((path, each) => pattern(`rock-${each}`, 16, path)).join("")}
    <radialGradient id="glow"><stop offset="0"/><stop offset="1" stop-opacity="0"/></radialGradient></defs>
  <g class="all"><g data-part="ground"></g><path class="rail" d="M${x - 104} 26V352M${x + 104} 26V352"/>
  <path class="fixed" d="M${x - 116} 12H${x + 116}V26H${x - 116}Z"/><path class="line" d="M${x - 116} 26H${x + 116}"/>
  ${spring(x - 74)}${spring(x + 74)}${label(19, "load unit", 116)}${label(52, "load spring", 86)}
  <g data-part="tool" class="tool"><rect data-part="shank" x="${x - 13}" y="17" width="26"/>
    <path d="M${x - 28} 4q0 -4 4 -4H${x + 24}q4 0 4 4V17H${x - 28}Z"/>
    <path class="break" d="M${x - 16} 34q8 -7 16 0t16 0v6q-8 7 -16 0t-16 0Z"/>
    <path class="edge" d="M${x - 16} 34q8 -7 16 0t16 0M${x - 16} 40q8 -7 16 0t16 0"/>
    <g data-part="bit"><path d="M${x - 13} -34l-7 14v13l7 7l7 -5l6 5l6 -5l7 5l7 -7v-13l-7 -14Z"/>
      <path class="edge" d="M${x - 20} -18l40 6M${x - 20} -12l40 6"/></g></g>
  <g data-part="tip" class="plane"><rect x="${x - 13}" y="-58" width="26" height="58"/></g>
  <g data-part="plane" class="plane"><path d="M${x - 31} -106q0 -4 4 -4H${x + 27}q4 0 4 4V-66H${x - 31}Z"/>
    <rect x="${x - 8}" y="-118" width="16" height="8"/>${[-64, -50.5, -37, -23.5].map(crystal).join("")}
    <path class="lead" d="M${x - 29} -51.5h-11v-62M${x - 29} -24.5h-16v-89"/>
    <path d="M${x - 33} -10h66v22h-66Z"/><polygon points="${sides.join(" ")}"/>
    <path d="M${x - 96} -5h192v10h-192ZM${x - 112} -13h16v26h-16ZM${x + 96} -13h16v26h-16Z"/>
    ${label(-44, "piezo stack", 25)}${label(0, "nodal plane", 112)}${label(48, "horn", 18)}${label(88, "tip", 13, "tip-text")}</g>
  <g data-part="mass" class="mass"><rect x="${x - 34}" width="68" height="${SECTION_MASS}" rx="3"/>
    <rect class="cut" x="${x - 34}" width="68" height="${SECTION_MASS}" rx="3"/></g>
  <path class="axis" d="M${x} 4V${SECTION_BOTTOM}"/>
  ${moving(384, "free mass", "mass")}${moving(420, "drill tool", "tool")}<text data-part="step" class="muted" x="352" y="441"></text>
  <text data-part="drawn" class="muted" x="352" y="459"></text>
  <g data-part="flash" class="force" opacity="0"><ellipse cx="${x}" rx="74" ry="15"/>
    <text data-part="force" class="big" x="${x - 46}" y="6" text-anchor="end"></text></g>
  <path data-part="chips" class="chips" d=""/>
  <g class="scale"><path class="line" data-part="bar"/><text data-part="length" x="28"></text></g>
  <text class="halo air" x="${x}" y="706" text-anchor="middle">not in the rock</text></g>
  <text class="none" x="${x}" y="620" text-anchor="middle">no waveform yet</text>`;
}

/** Draw the section of the drill into a figure, with its pace and its magnifications below.
 * @param {HTMLElement} element @param {import("./clock.js").MotionClock} clock */
export function mountSection(element, clock) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 540 720");
  svg.setAttribute("role", "img");
  svg.innerHTML = sectionDrawing();
  const speed = document.createElement("select"), hold = document.createElement("button");
  const [legend, pace, factors] = ["p", "span", "span"].map((name) => document.createElement(name));
  for (const each of [1, 2, 5, 20]) speed.add(new Option(`${1e3 / each}\u00d7`, `${each}`, each === clock.speed, each === clock.speed));
  speed.ariaLabel = "slow motion";
  speed.addEventListener("change", () => { clock.speed = Number(speed.value); });
  hold.addEventListener("click", () => clock.toggle());
  pace.className = "pace";
  pace.append("slow motion ", speed, " ", hold);
  legend.append(pace, factors);
  element.classList.add("section");
  element.replaceChildren(svg, legend);

  /** @type {Record<string, SVGElement[]>} */ const parts = {};
  for (const part of /** @type {NodeListOf<SVGElement>} */ (svg.querySelectorAll("[data-part]"))) (parts[part.dataset.part ?? ""] ??= []).push(part);
  const set = (/** @type {string} */ part, /** @type {string} */ name, /** @type {string | number} */ value) => {
    for (const each of parts[part]) if (each.getAttribute(name) !== `${value}`) each.setAttribute(name, `${value}`);
  };
  const move = (/** @type {string} */ part, /** @type {number} */ y) => set(part, "transform", `translate(0 ${y})`);
  const write = (/** @type {string} */ part, /** @type {string} */ text) => { parts[part][0].textContent = text; };
  const make = (/** @type {string} */ name, /** @type {Record<string, string | number>} */ values, text = "") => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const each in values) made.setAttribute(each, `${values[each]}`);
    made.textContent = text;
    return made;
  };
  const path = (/** @type {string} */ name, /** @type {string} */ d) => make("path", { class: name, d });
  const text = (/** @type {string} */ name, /** @type {number} */ x, /** @type {number} */ y, /** @type {string} */ said, anchor = "end") =>
    make("text", { class: name, x, y, "text-anchor": anchor }, said);

  let ratio = 1, factor = 0, stepFactor = 0; // CSS pixels to a unit; magnification of motions, and below the place of touch
  let crushed = 0, bottom = SECTION_ROCK, bit = SECTION_ROCK; // height of the crushed rock, places of the hole's bottom and of the bit
  let inRock = true, touches = true, drawn = "", told = -Infinity;
  /** @type {Hole | null} */ let hole = null;

  const magnified = (/** @type {number} */ length, /** @type {number} */ by) => (length * by) / SECTION_PIXEL / ratio;
  const units = (/** @type {number} */ position) => magnified(position, position > 0 ? stepFactor : factor);
  const greatest = (/** @type {number} */ motion, /** @type {number} */ room) =>
    SECTION_FACTORS.findLast((each) => magnified(motion, each) <= room) ?? 1;

  /** Choose the magnifications for a block; they stay while they suit. */
  function scale() {
    const block = clock.block;
    let up = 0, down = 0, vibration = 0;
    block?.actuator.forEach((tip, each) => {
      const [plane, mass, tool] = [block.nodal_plane[each], block.free_mass[each], block.drill_tool[each]];
      if (!Number.isFinite(plane + tip + mass + tool)) return;
      [up, down] = [Math.max(up, -plane, -tip, -mass, -tool), Math.max(down, tip, mass, tool)];
      vibration = Math.max(vibration, Math.abs(tip - plane));
    });
    inRock = touches;
    const kept = (/** @type {number} */ now, /** @type {number} */ best) => (now <= best && now * 4 > best ? now : best);
    if (up > 1e-6) factor = kept(factor, Math.min(greatest(up, SECTION_UP), greatest(vibration, SECTION_STEP)));
    stepFactor = inRock ? kept(stepFactor, greatest(Math.max(down, 2e-5), SECTION_STEP)) : greatest(down, hole ? Math.max(bottom - bit, SECTION_STEP) : SECTION_DOWN);
    factor = Math.min(factor || 5, stepFactor);
    if (!inRock) stepFactor = factor;
    crushed = inRock ? units(down) + 4 : 0;
    const length = SECTION_LENGTHS.findLast((each) => magnified(each, factor) <= 90) ?? 1e-6, top = SECTION_TOUCH - magnified(length, factor);
    set("bar", "d", `M14 ${SECTION_TOUCH}h8m-4 0V${top}m-4 0h8`);
    set("length", "y", (SECTION_TOUCH + top) / 2 + 4);
    write("length", sectionLength(length));
    factors.textContent = `motion drawn ${factor}×`;
    const indents = block && stepFactor > factor;
    write("step", indents ? `indentation ${sectionLength(down, 2)}` : "");
    write("drawn", indents ? `drawn ${stepFactor}×` : "");
    write("tip-text", vibration > 1e-7 ? `tip, vibrates ±${sectionLength(vibration, 2)}` : "tip");
    element.classList.toggle("free", !inRock);
    ground();
  }

  /** Draw rock, hole, ruler and well log, where they have changed. */
  function ground() {
    const known = Number.isFinite(hole?.depth), deep = known ? Number(hole?.depth) : 0;
    const log = known ? hole?.log : null, tracks = SECTION_TRACKS.filter(([name]) => log && Array.from(log[name]).some(Number.isFinite));
    const layers = hole?.layers?.length ? hole.layers : [{ from: 0, to: null, name: "rock", colour: 3 }];
    const tip = inRock ? deep : Math.min(hole?.tip ?? -Infinity, deep), drawsRock = inRock || known;
    const state = JSON.stringify([known, deep.toPrecision(4), tip.toPrecision(4), layers, log?.depth.length, tracks.length, inRock, crushed]);
    if (state === drawn) return;
    drawn = state;
    const boundary = layers.find((each) => each.from > deep)?.from ?? 0;
    const shown = roundUp(Math.max(1.3 * deep, Math.min(1.15 * boundary, 10 * Math.max(deep, 2e-3)), 2e-3), SECTION_ROUND);
    const at = (/** @type {number} */ value) => SECTION_ROCK + (Math.min(value, shown) / shown) * (SECTION_BOTTOM - SECTION_ROCK);
    const drawing = [], left = SECTION_LEFT, right = 526 - 96 * tracks.length, wall = [SECTION_AXIS - 23, SECTION_AXIS + 23];
    bottom = at(deep);
    bit = !drawsRock ? SECTION_ROCK : Math.max(at(tip), SECTION_ROCK - SECTION_ABOVE); // one without an arm is above the face
    if (drawsRock) {
      for (const { from, to, name, colour } of layers.filter((each) => each.from < shown)) {
        const y = at(from), height = Math.max(at(to ?? shown) - y, 0);
        for (const fill of [`var(--stratum-${colour % 6})`, `url(#rock-${colour % 6})`])
          drawing.push(make("rect", { fill, x: left, y, width: right - left, height }));
        if (from > 0) drawing.push(path("line", `M${left} ${y}H${right}`));
        const label = text(deep >= from && deep < (to ?? Infinity) ? "halo now" : "halo", right - 8, y + 17, name), room = right - wall[1] - 12;
        if (name.length * 8.8 > room) label.setAttribute("textLength", `${room}`), label.setAttribute("lengthAdjust", "spacingAndGlyphs");
        if (height > 15) drawing.push(label);
      }
      const loose = `M${wall[0]} ${bottom}H${wall[1]}v${crushed}H${wall[0]}Z`;
      drawing.push(path("hole", `M${wall[0]} ${SECTION_ROCK - 1}H${wall[1]}V${bottom + crushed}H${wall[0]}Z`), path("crushed", loose),
        path("rubble", loose), path("edge", `M${left} ${SECTION_ROCK}H${wall[0]}V${bottom + crushed}H${wall[1]}V${SECTION_ROCK}H${right}`));
    }
    if (known) {
      drawing.push(path("line", `M${left - 6} ${SECTION_ROCK}V${SECTION_BOTTOM}`), path("mark", `M${left - 6} ${bottom}l-8 -5v10Z`),
        text("now", left - 17, bottom + 4, `${+(deep * 1e3).toPrecision(3)}`), text("muted", 8, SECTION_ROCK - 14, "depth, mm", "start"));
      for (const tick of sectionTicks(shown * 1.001, 5)) {
        drawing.push(path("line", `M${left - 6} ${at(tick)}h-5`));
        if (tick && Math.abs(at(tick) - bottom) > 14) drawing.push(text("muted", left - 14, at(tick) + 4, `${+(tick * 1e3).toPrecision(3)}`));
      }
      tracks.forEach(([name, unit, scale], each) => drawing.push(...track(name, unit, scale, 448 - 96 * each, at)));
    }
    parts.ground[0].replaceChildren(...drawing);
    set("shank", "height", bit - SECTION_TOOL - 37);
    move("bit", bit - SECTION_TOOL);
    picture();
  }

  /** @param {"rate" | "torque"} name @param {string} unit @param {number} scale @param {number} left @param {(depth: number) => number} at */
  function track(name, unit, scale, left, at) {
    const width = 78, values = Array.from(hole?.log?.[name] ?? [], (each) => each * scale), depths = hole?.log?.depth ?? [];
    const known = values.filter(Number.isFinite).sort((a, b) => a - b);
    // The first moments in a rock can be far above all others.
    const most = roundUp(Math.max(known[Math.floor(0.97 * (known.length - 1))] ?? 0, 1e-3), SECTION_ROUND);
    const points = values.map((value, row) => !Number.isFinite(value) ? ""
      : `${(left + Math.min(Math.max(value / most, 0), 1) * width).toFixed(1)} ${at(depths[row]).toFixed(1)}`);
    const grid = [0, width / 2, width].map((across) => `M${left + across} ${SECTION_ROCK}V${SECTION_BOTTOM}`).join("");
    return [path("grid", grid), path("line", `M${left} ${SECTION_ROCK}h${width}`), path(`curve ${name}`, `M${points.filter(Boolean).join("L")}`),
      text(name, left, SECTION_ROCK - 24, name, "start"), text("muted", left + width, SECTION_ROCK - 6, `${+most.toPrecision(3)} ${unit}`)];
  }

  /** Put the bodies where they are at the clock's place. */
  function picture() {
    const block = clock.block, positions = SECTION_BODIES.map((body) => block?.[body][clock.sample] ?? 0);
    if (!positions.every(Number.isFinite)) return; // nothing was recorded there: the picture before stays
    const plane = SECTION_PLANE + magnified(positions[0], factor), tip = SECTION_TOUCH + units(positions[1]);
    const mass = SECTION_TOUCH + units(positions[2]), tool = SECTION_TOOL + units(positions[3]);
    set("spring", "transform", `scale(1 ${(plane - 31) / 100})`);
    for (const [part, y] of Object.entries({ plane, tip, mass, tool, flash: tool })) move(part, y);
    set("mass-line", "d", `M${SECTION_AXIS + 34} ${mass + SECTION_MASS / 2}L330 384H346`);
    set("tool-line", "d", `M${SECTION_AXIS + 28} ${tool + 10}L330 420H346`);
    let flash = 0, said = "", chips = "";
    for (const [time, force, contact] of block?.impacts ?? []) {
      const age = ((clock.place - time) * 1e3) / clock.speed + clock.rest;
      if (clock.place < time || age > SECTION_CHIPS) continue;
      if (age < SECTION_FLASH) {
        flash = 1 - age / SECTION_FLASH;
        said = force ? valueText("peak_force", force) : "";
      }
      for (let chip = 0; inRock && contact && chip < 8; chip += 1) {
        // By chance, but the same whenever the same impact is shown.
        const chance = Math.abs(Math.sin(time * 1e5 + chip * 12.9898) * 43758.5453) % 1, size = 1.6 + 2.4 * ((chance * 13) % 1);
        const above = SECTION_ROCK - 3 - (90 + 150 * ((chance * 7) % 1)) * age + 420 * age * age;
        const across = SECTION_AXIS + (chip % 2 ? 1 : -1) * (21 + (30 + 95 * chance) * age);
        if (above < SECTION_ROCK - 2) chips += `M${across.toFixed(1)} ${above.toFixed(1)}l${size} ${-size * 0.6}l${size * 0.7} ${size}Z`;
      }
    }
    set("flash", "opacity", flash.toFixed(2));
    write("force", said);
    set("chips", "d", chips);
  }

  /** Say the picture in words, at most once a second. */
  function tell() {
    const now = performance.now(), block = clock.block;
    if (block && now - told < 1000) return;
    told = block ? now : -Infinity;
    const at = (/** @type {Float32Array} */ positions) => sectionLength(positions[clock.sample]);
    svg.ariaLabel = !block ? "Section of the drill: no waveform yet." : `Section of the drill at ${(block.time + clock.place).toFixed(4)} s. `
      + `Nodal plane at ${at(block.nodal_plane)}, free mass at ${at(block.free_mass)}, drill tool at ${at(block.drill_tool)}; `
      + `${block.impacts.length} impacts in ${Math.round(clock.end * 1e3)} ms.${hole?.depth ? ` The hole is ${sectionLength(hole.depth)} deep.` : ""}`;
  }

  new ResizeObserver(() => {
    const { width, height } = svg.getBoundingClientRect();
    ratio = Math.min(width / 540, height / 720) || 1;
    svg.style.fontSize = `${Math.max(13, Math.min(12 / ratio, 17))}px`; // 12 px of the page
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
    /** Show the hole. @param {Hole | null} value */
    setHole(value) { hole = value; scale(); },
    /** Show the drill in the rock, or before it. @param {boolean} value */
    setContact(value) { if (value !== touches) { touches = value; scale(); } },
  };
}
