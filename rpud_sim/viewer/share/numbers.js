// @ts-check
/* Five numbers of the last second, each with its extremes and how it went. */
import { quantityOf, valueText } from "./quantities.js";

const SVG = "http://www.w3.org/2000/svg";
const NAMES = ["impact_rate", "peak_force", "reacting_force", "power", "penetration_rate"];
const [SPARK_WIDTH, SPARK_HEIGHT] = [100, 24];

/** Row of numbers; one that the drill does not have is left out. */
export class Numbers {
  /** @param {HTMLElement} host list of descriptions */
  constructor(host) {
    this.tiles = NAMES.map((name) => {
      const tile = document.createElement("div");
      const make = /** @param {string} tag */ (tag) => document.createElement(tag);
      const [label, body, value, unit, ends] = ["dt", "dd", "output", "small", "small"].map(make);
      const spark = document.createElementNS(SVG, "svg");
      spark.setAttribute("viewBox", `0 0 ${SPARK_WIDTH} ${SPARK_HEIGHT}`);
      spark.setAttribute("preserveAspectRatio", "none");
      spark.setAttribute("aria-hidden", "true");
      const line = spark.appendChild(document.createElementNS(SVG, "polyline"));
      value.dataset.number = name;
      ends.className = "ends";
      body.append(value, unit, spark, ends);
      tile.append(label, body);
      host.append(tile);
      return { name, tile, label, value, unit, ends, line };
    });
  }

  /** @param {Record<string, import("./frames.js").NumberOf | null>} numbers */
  draw(numbers) {
    for (const { name, tile, label, value, unit, ends, line } of this.tiles) {
      const shown = numbers[name];
      const quantity = quantityOf(name);
      tile.hidden = !shown;
      tile.style.setProperty("--of", `var(--${quantity.colour})`);
      label.textContent = quantity.label;
      unit.textContent = quantity.unit;
      value.textContent = valueText(name, shown?.mean, false, true);
      value.dataset.exact = String(shown?.mean);
      const spread = shown && shown.least !== null && shown.greatest !== null && shown.least !== shown.greatest;
      ends.textContent = spread ? `${valueText(name, shown.least, false)} to ${valueText(name, shown.greatest, false)}` : "";
      line.setAttribute("points", sparkPoints(shown?.spark ?? []));
    }
  }
}

/** @param {ArrayLike<number>} values @returns {string} places of a line through them */
function sparkPoints(values) {
  const known = Array.from(values).filter(Number.isFinite);
  const [low, high] = [Math.min(0, ...known), Math.max(1e-12, ...known)];
  return Array.from(values)
    .map((value, i) => [(i / Math.max(1, values.length - 1)) * SPARK_WIDTH, value])
    .filter(([, value]) => Number.isFinite(value))
    .map(([x, value]) => `${x.toFixed(1)},${(SPARK_HEIGHT - 1 - ((value - low) / (high - low)) * (SPARK_HEIGHT - 2)).toFixed(1)}`)
    .join(" ");
}
