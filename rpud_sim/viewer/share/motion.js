// @ts-check
/* Zigzag of the free mass between tip and tool, over the same 20 ms and at the same place as the section. */
import { make } from "./dom.js";
import { AXIS, END, axisOf, keepSize, sizeOf } from "./marks.js";
import { columnOf } from "./plots.js";
import { colourOf, quantityOf, valueText } from "./quantities.js";

const MOTION_FORCES = 34; // height of the forces, below the motion [px]
const MOTION_LINES = /** @type {const} */ ([["actuator", "tip", "plane"], ["free_mass", "free mass", "mass"], ["drill_tool", "drill tool", "tool"]]);

/** Middle of each contact [s]. @param {import("./frames.js").Section} block */
const motionStruck = (block) => block.impacts.map(([time, , length]) => time + (length || 0) / 2);

/** Draw the motion of the bodies into a figure. @param {HTMLElement} element @param {import("./clock.js").MotionClock} clock */
export function mountMotion(element, clock) {
  const area = make("div", { className: "area", tabIndex: 0, role: "slider", ariaLabel: "place in the motion of 20 ms", ariaValueMax: "0" });
  const cursor = make("div", { className: "cursor" }), dot = make("i"), title = make("figcaption"), unit = make("small");
  const outputs = MOTION_LINES.map(([, label, colour]) => {
    const entry = make("span", { className: "key" }), output = make("output", { ariaLive: "off" });
    entry.style.setProperty("--of", `var(--${colour})`);
    entry.append(make("span", { textContent: label }), output);
    title.append(entry);
    return output;
  });
  const name = make("b"); // with its time: slow motion is of before
  title.prepend(name, unit);
  cursor.append(dot);
  area.append(cursor);
  element.classList.add("plot", "motion");
  element.replaceChildren(title, area);
  let told = -1e9, low = 0, high = 1; // ends of the motion, in its unit

  /** @type {(plot: uPlot, ticks: number[]) => (number | null)[]} */
  const above = (_, ticks) => ticks.map((each) => (each < high ? each : null)); // the forces
  const plot = new uPlot({
    ...sizeOf(area), legend: { show: false }, cursor: { show: false }, padding: [6, END, 0, 0],
    series: [{}, ...MOTION_LINES.map(([body, , paint]) => (
      { stroke: () => colourOf(paint), width: body === "free_mass" ? 1.6 : 1, pxAlign: 0, points: { show: false } }))],
    scales: {
      x: { time: false, range: () => [-1e3 * (clock.end || 0.02), 0] }, // ms before the newest
      y: { dir: -1, range: () => [low, high + ((high - low) * MOTION_FORCES) / Math.max(area.clientHeight - MOTION_FORCES - 24, 20)] },
    },
    axes: [
      axisOf({ size: 18, gap: 4, space: 90, values: (_, ticks) => ticks.map((each) => (each ? `${each} ms`.replace("-", "\u2212") : "0")) }),
      axisOf({ size: AXIS, gap: 6, space: 26, filter: above, grid: { stroke: () => colourOf("rule"), width: 1, filter: above } }),
    ],
    hooks: { draw: [drawForces] },
  }, [[], ...MOTION_LINES.map(() => [])], area);

  function draw() {
    const { block } = clock, { scale, unit: text } = quantityOf("free_mass");
    unit.textContent = text;
    name.textContent = block ? `motion, ${block.time.toFixed(3)} to ${(block.time + clock.end).toFixed(3)} s` : "motion";
    const columns = MOTION_LINES.map(([body]) => columnOf(block?.[body], block?.free_mass.length ?? 0, scale));
    const known = /** @type {number[]} */ (columns.flat().filter((each) => each !== null));
    const [least, most] = known.reduce(([a, b], each) => [Math.min(a, each), Math.max(b, each)], [Infinity, -Infinity]);
    if (known.length) [low, high] = [least - Math.max(0.04 * (most - least), 2e-6 * scale), most + Math.max(0.04 * (most - least), 2e-6 * scale)];
    plot.setData([columns[0].map((_, each) => ((block?.period ?? 0) * each - clock.end) * 1e3), ...columns]);
  }

  /** @param {uPlot} plot */
  function drawForces({ ctx, bbox, valToPos }) {
    const { block } = clock, ratio = uPlot.pxRatio, base = bbox.top + bbox.height, right = bbox.left + bbox.width;
    ctx.save();
    Object.assign(ctx, { font: `${12 * ratio}px system-ui, sans-serif`, textBaseline: "middle", textAlign: "center", fillStyle: colourOf("text") });
    if (!block) ctx.fillText("no waveform yet", bbox.left + bbox.width / 2, bbox.top + bbox.height / 2);
    else if (block.impacts.length) ctx.fillText(quantityOf("peak_force").unit, bbox.left - 14 * ratio, base - 6 * ratio);
    const { credible } = quantityOf("peak_force"), strongest = Math.max(...(block?.impacts ?? []).map(([, peak]) => (peak < credible ? peak : 0)), 1), struck = block ? motionStruck(block) : [];
    let free = bbox.left - 2 * ratio;
    ctx.fillStyle = colourOf("force");
    block?.impacts.forEach(([time, peak], each) => {
      const x = valToPos((struck[each] - clock.end) * 1e3, "x", true), height = (Math.min(peak / strongest, 1) || 0) * (MOTION_FORCES - 16) * ratio;
      ctx.fillRect(x - ratio, base - height, 2 * ratio, height);
      ctx.beginPath();
      const tool = block.drill_tool[Math.min(Math.round(time / block.period), block.drill_tool.length - 1)];
      ctx.arc(x, valToPos(tool * quantityOf("drill_tool").scale, "y", true), 2.5 * ratio, 0, 7);
      ctx.fill();
      const text = peak ? valueText("peak_force", peak, false) : "", half = ctx.measureText(text).width / 2;
      const middle = Math.min(Math.max(x, bbox.left + half), right - half);
      if (middle - half < free) return;
      ctx.fillText(text, middle, base - height - 7 * ratio);
      free = middle + half + 3 * ratio;
    });
    ctx.restore();
  }

  function move() {
    const block = clock.block, now = performance.now(), sample = clock.sample;
    cursor.hidden = !block;
    for (const output of block ? [] : outputs) output.textContent = "";
    if (!block) return void (area.ariaValueText = "no waveform yet");
    const before = (clock.place - clock.end) * 1e3, stands = clock.held || clock.resting;
    cursor.style.transform = `translateX(${AXIS + plot.valToPos(before, "x")}px)`;
    dot.style.transform = `translateY(${6 + plot.valToPos(block.free_mass[sample] * quantityOf("free_mass").scale, "y")}px)`;
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
    clock.still(plot.posToVal(event.clientX - area.getBoundingClientRect().left - AXIS, "x") / 1e3 + clock.end);
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

  keepSize(plot, area, move);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plot.redraw());
  clock.listen((changed) => {
    if (changed) draw();
    move();
  });
}
