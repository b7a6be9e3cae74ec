/* Animated section of the drill: one block of the waveform in slow motion.
 *
 * All bodies move in true proportion, by one factor; their own sizes are a scheme. Zero of all
 * motions is where actuator, free mass and drill tool just touch.
 */
"use strict";
var rpudSection = (() => {
  const find = (id) => document.getElementById(id);
  const PIXEL = 0.0254 / 96; // of CSS [m]
  const TOUCH = 290, MASS = 26, PLANE = 178; // places at rest: tip, height of the mass, nodal plane
  const ROOM = 115; // pixels that the farthest motion may take
  const FLASH = 350; // ms
  const PAINT = 40; // between pictures [ms]
  const FACTORS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000];
  const still = window.matchMedia("(prefers-reduced-motion: reduce)");
  let block = null, next = null, began = 0, shown = -1, factor = 0, flashed = -1e9, wanted = false;
  let want = () => {};
  let lastStill = 0, ticking = false;

  function floats(text) {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return new Float32Array(bytes.buffer);
  }

  function set(section) {
    next = { ...section };
    for (const name of ["nodal_plane", "actuator", "free_mass", "drill_tool"])
      next[name] = floats(section[name]);
    wanted = false;
    if (still.matches) {
      const now = performance.now();
      if (now - lastStill < 900 && block) return;
      lastStill = now;
      begin(now);
      draw(block.nodal_plane.length - 1);
    } else if (!ticking) {
      ticking = true;
      requestAnimationFrame(tick);
    }
  }

  function begin(now) {
    block = next;
    next = null;
    began = now;
    shown = -1;
    let farthest = 1e-7;
    for (const name of ["nodal_plane", "free_mass", "drill_tool"])
      for (const value of block[name]) farthest = Math.max(farthest, Math.abs(value));
    const fits = (each) => farthest * each / PIXEL <= ROOM;
    if (!fits(factor || Infinity) || !factor || farthest * factor / PIXEL < ROOM / 8)
      factor = FACTORS.filter(fits).pop() || FACTORS[0];
    scale();
  }

  function scale() {
    const lengths = [1e-6, 2e-6, 5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2];
    const length = lengths.filter((each) => each * factor / PIXEL <= 80).pop() || lengths[0];
    const pixels = length * factor / PIXEL;
    find("s-bar").setAttribute("y1", 404 - pixels);
    find("s-bar").setAttribute("y2", 404);
    find("s-bar-text").setAttribute("y", 408 - pixels / 2);
    find("s-bar-text").textContent = length >= 1e-3 ? `${length * 1e3} mm` : `${Math.round(length * 1e6)} µm`;
    find("section-scale").textContent =
      `of the drill's time. Motion is drawn ${factor} times its size, the same for all bodies.`;
  }

  const speed = () => Number(find("slow").value);

  let painted = -1e9;
  function tick(now) {
    if (still.matches) return;
    if (now - painted < PAINT - 4) { // more would only heat the machine
      requestAnimationFrame(tick);
      return;
    }
    painted = now;
    if (!block && next) begin(now);
    if (!block) return;
    const length = block.nodal_plane.length;
    const place = Math.floor((now - began) / 1e3 * speed() / block.period);
    if (place > length * 0.7 && !wanted && !next) {
      wanted = true;
      want();
    }
    if (place >= length) {
      if (shown < length - 1) draw(length - 1);
      if (next) begin(now);
      else { // the drill stands still, or the next block is on its way
        fade(now);
        setTimeout(() => requestAnimationFrame(tick), 100);
        return;
      }
    } else draw(place);
    fade(now);
    requestAnimationFrame(tick);
  }

  function fade(now) {
    const left = Math.max(0, 1 - (now - flashed) / FLASH);
    find("s-flash").setAttribute("opacity", left.toFixed(2));
  }

  function draw(place) {
    const pixels = factor / PIXEL;
    const plane = block.nodal_plane[place] * pixels;
    const tip = plane + block.actuator[place] * pixels;
    const mass = block.free_mass[place] * pixels;
    const tool = block.drill_tool[place] * pixels;
    const move = (id, y) => find(id).setAttribute("transform", `translate(0 ${y.toFixed(2)})`);
    move("s-plane", plane);
    move("s-mass", TOUCH + mass);
    move("s-tool", TOUCH + MASS + tool);
    const top = PLANE + 28 + plane, end = TOUCH + tip;
    find("s-horn").setAttribute("d",
      `M95 ${top} C112 ${top + 30} 118 ${end - 40} 118 ${end} H142 C142 ${end - 40} 148 ${top + 30} 165 ${top} Z`);
    const coils = [];
    const bottom = PLANE - 28 + plane;
    for (let each = 0; each <= 8; each += 1)
      coils.push(`${each === 0 || each === 8 ? 130 : each % 2 ? 112 : 148},${(10 + (bottom - 10) * each / 8).toFixed(1)}`);
    find("s-spring").setAttribute("points", coils.join(" "));
    const from = shown < 0 ? 0 : shown * block.period, to = (place + 1) * block.period;
    for (const [time, force] of block.impacts)
      if (time >= from && time < to) {
        flashed = performance.now();
        find("s-flash").setAttribute("transform", `translate(0 ${(TOUCH + MASS + tool).toFixed(1)})`);
        find("s-force").textContent = `${(force / 1e3).toFixed(2)} kN`;
      }
    shown = place;
    tell(place);
  }

  let told = 0;
  function tell(place) {
    const now = performance.now();
    if (now - told < 1000) return; // a text that changes faster cannot be read
    told = now;
    const mm = (name) => `${(block[name][place] * 1e3).toFixed(3)} mm`;
    find("section-text").textContent =
      `Section of the drill at ${(block.time + place * block.period).toFixed(4)} s: nodal plane at `
      + `${mm("nodal_plane")}, free mass at ${mm("free_mass")}, drill tool at ${mm("drill_tool")}; `
      + `${block.impacts.length} impacts in this block.`;
  }

  find("slow").addEventListener("change", () => {
    if (block && shown >= 0) began = performance.now() - shown * block.period / speed() * 1e3;
  });
  setInterval(() => { if (still.matches && block && !wanted) { wanted = true; want(); } }, 1000);
  return { set, onWant: (call) => { want = call; }, clear: () => { block = next = null; wanted = false; } };
})();
