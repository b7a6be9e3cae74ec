// @ts-check
// Zigzag of the free mass between tip and tool, over the same 20 ms and at the same place as the section.

/** @typedef {import("./clock.js").MotionClock} Clock */

const MOTION_LEFT = 52, MOTION_RIGHT = 10, MOTION_TOP = 8, MOTION_FORCES = 40, MOTION_BOTTOM = 20; // px

/** Multiples of a round length within a range, about so many. @param {number} low @param {number} high @param {number} count */
function motionTicks(low, high, count) {
  const rough = (high - low) / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(rough));
  const every = power * ([1, 2, 5].find((each) => each * power >= rough) ?? 10), ticks = [];
  for (let each = Math.ceil(low / every); each * every <= high; each += 1) ticks.push(+(each * every).toPrecision(9));
  return ticks;
}

/**
 * Draw the motion of the bodies into an element.
 * @param {HTMLElement} element @param {Clock} clock
 * @param {{unit: string, scale: number}} quantity of positions
 */
export function mountMotion(element, clock, quantity = { unit: "mm", scale: 1e3 }) {
  element.classList.add("motion");
  const canvas = document.createElement("canvas"), cursor = document.createElement("div");
  cursor.className = "cursor";
  element.replaceChildren(canvas, cursor);
  element.tabIndex = 0;
  for (const [name, value] of [["role", "slider"], ["aria-label", "motion of the last 20 ms"], ["aria-valuemax", "0"]])
    element.setAttribute(name, value);
  let width = 0, height = 0;
  let told = -1e9;

  const x = (/** @type {number} */ place) =>
    MOTION_LEFT + (clock.end ? place / clock.end : 0) * (width - MOTION_LEFT - MOTION_RIGHT);

  function draw() {
    const context = canvas.getContext("2d");
    if (!context || !width || !height) return;
    const style = getComputedStyle(element), dense = devicePixelRatio || 1;
    const colour = (/** @type {string} */ name, /** @type {string} */ other) => style.getPropertyValue(`--${name}`).trim() || other;
    const muted = colour("muted", "#667085"), line = colour("line", "#d5dae2");
    canvas.width = Math.round(width * dense);
    canvas.height = Math.round(height * dense);
    context.scale(dense, dense);
    context.font = `12px ${style.fontFamily}`;
    context.textBaseline = "middle";
    const block = clock.block;
    if (!block) {
      context.fillStyle = style.color;
      context.textAlign = "center";
      context.fillText("no waveform yet", width / 2, height / 2);
      return;
    }
    let low = Infinity, high = -Infinity;
    for (const values of [block.nodal_plane, block.actuator, block.free_mass, block.drill_tool])
      for (const value of values) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    const margin = Math.max(0.04 * (high - low), 2e-6);
    low -= margin;
    high += margin;
    const end = height - MOTION_BOTTOM - MOTION_FORCES, right = width - MOTION_RIGHT;
    // Toward the rock is down, as in the section.
    const y = (/** @type {number} */ value) => MOTION_TOP + ((value - low) / (high - low)) * (end - MOTION_TOP);

    context.strokeStyle = line;
    context.fillStyle = muted;
    context.textAlign = "right";
    context.beginPath();
    for (const tick of motionTicks(low * quantity.scale, high * quantity.scale, end / 36)) {
      context.moveTo(MOTION_LEFT, y(tick / quantity.scale));
      context.lineTo(right, y(tick / quantity.scale));
      context.fillText(`${tick}`.replace("-", "\u2212"), MOTION_LEFT - 6, y(tick / quantity.scale));
    }
    context.textAlign = "center";
    for (const tick of motionTicks(-clock.end * 1e3, 0, width / 90)) {
      const place = x(clock.end + tick / 1e3);
      context.moveTo(place, MOTION_TOP);
      context.lineTo(place, height - MOTION_BOTTOM);
      context.fillText(tick ? `${tick}`.replace("-", "\u2212") : "0 ms", Math.min(place, right - 12), height - MOTION_BOTTOM / 2);
    }
    context.stroke();
    context.textAlign = "left";
    context.fillText(quantity.unit, 4, MOTION_TOP + 4);
    context.fillText("kN", 4, height - MOTION_BOTTOM - 6);

    const count = block.free_mass.length;
    // Least and greatest of each pixel, as one shape: the tip vibrates faster than pixels.
    const band = (/** @type {Float32Array} */ values, /** @type {string} */ paint, /** @type {number} */ thick) => {
      const columns = Math.max(Math.min(Math.round(right - MOTION_LEFT), count), 1), lows = [];
      context.strokeStyle = context.fillStyle = paint;
      context.lineWidth = thick;
      context.beginPath();
      for (let each = 0; each < columns; each += 1) {
        const first = Math.floor((each * count) / columns);
        let least = Infinity, most = -Infinity;
        for (let sample = first; sample <= Math.min(Math.floor(((each + 1) * count) / columns), count - 1); sample += 1) {
          least = Math.min(least, values[sample]);
          most = Math.max(most, values[sample]);
        }
        const place = x(((first + Math.floor(((each + 1) * count) / columns)) / 2) * block.period);
        context.lineTo(Math.min(place, right), y(most));
        lows.push([Math.min(place, right), y(least)]);
      }
      for (const [place, value] of lows.reverse()) context.lineTo(place, value);
      context.closePath();
      context.fill();
      context.stroke();
    };
    band(block.nodal_plane, muted, 0.6);
    band(block.actuator, colour("plane", "#3467a8"), 1);
    band(block.drill_tool, colour("tool", "#4d7a55"), 2);
    context.strokeStyle = colour("mass", "#b0701a");
    context.lineWidth = 1.8;
    context.lineJoin = "round";
    context.beginPath();
    block.free_mass.forEach((value, sample) => context.lineTo(x(sample * block.period), y(value)));
    context.stroke();

    const force = colour("force", "#c2410c"), base = height - MOTION_BOTTOM;
    const strongest = Math.max(...block.impacts.map(([, peak]) => peak), 1);
    let free = MOTION_LEFT - 2;
    context.strokeStyle = context.fillStyle = force;
    context.lineWidth = 2;
    for (const [time, peak, length] of block.impacts) {
      const place = x(time + (length || 0) / 2), top = base - (peak / strongest) * (MOTION_FORCES - 14);
      context.beginPath();
      context.moveTo(place, base);
      context.lineTo(place, top);
      context.stroke();
      context.beginPath();
      context.arc(place, y(block.drill_tool[Math.min(Math.round(time / block.period), count - 1)]), 3, 0, 7);
      context.fill();
      const text = (peak / 1e3).toFixed(1), half = context.measureText(text).width / 2;
      const middle = Math.min(Math.max(place, MOTION_LEFT + half), right - half);
      if (middle - half > free) {
        context.textAlign = "center";
        context.fillText(text, middle, top - 8);
        free = middle + half + 3;
      }
    }
  }

  function move() {
    const block = clock.block;
    cursor.hidden = !block;
    if (!block) return element.setAttribute("aria-valuetext", "no waveform yet");
    cursor.style.transform = `translateX(${x(clock.place)}px)`;
    const now = performance.now();
    if (now - told < 1000 && !clock.held) return;
    told = now;
    const before = (clock.place - clock.end) * 1e3, mass = block.free_mass[clock.sample] * quantity.scale;
    element.setAttribute("aria-valuemin", (-clock.end * 1e3).toFixed(1));
    element.setAttribute("aria-valuenow", before.toFixed(2));
    element.setAttribute("aria-valuetext", `${(-before).toFixed(1)} ms before the newest: free mass at ${mass.toFixed(2)} ${quantity.unit}`);
  }

  const point = (/** @type {PointerEvent} */ event) => clock.still(
    ((event.clientX - element.getBoundingClientRect().left - MOTION_LEFT) / (width - MOTION_LEFT - MOTION_RIGHT)) * clock.end);
  element.addEventListener("pointerdown", (event) => {
    if (!clock.block || event.button) return;
    element.setPointerCapture(event.pointerId);
    point(event);
  });
  element.addEventListener("pointermove", (event) => {
    if (element.hasPointerCapture(event.pointerId)) point(event);
  });
  element.addEventListener("keydown", (event) => {
    if (!clock.block || event.ctrlKey || event.altKey || event.metaKey) return;
    const struck = clock.block.impacts.map(([time, , length]) => time + (length || 0) / 2);
    /** @type {Record<string, number | undefined>} */
    const places = {
      ArrowLeft: clock.place - 1e-4, ArrowRight: clock.place + 1e-4, Home: 0, End: clock.end,
      PageUp: struck.filter((time) => time < clock.place - 1e-6).pop() ?? clock.place,
      PageDown: struck.find((time) => time > clock.place + 1e-6) ?? clock.place,
    };
    if (event.key === " ") clock.toggle();
    else if (event.key in places) clock.still(places[event.key] ?? 0);
    else return;
    event.preventDefault();
  });

  new ResizeObserver(() => {
    ({ width, height } = element.getBoundingClientRect());
    draw();
    move();
  }).observe(element);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  clock.listen((changed) => {
    if (changed) draw();
    move();
  });
}
