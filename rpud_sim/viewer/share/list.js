// @ts-check
/* Drills of a ROS domain; looks for new ones by itself. */
const list = /** @type {HTMLElement} */ (document.getElementById("drills"));
const said = /** @type {HTMLElement} */ (document.getElementById("said"));
let before = "";

/** @param {{state: string, regime: string, weight_on_bit: number, active_faults: number}} drill */
function describe(drill) {
  if (!drill.state) return "no status yet";
  const faults = drill.active_faults === 1 ? "1 fault" : `${drill.active_faults} faults`;
  return `${drill.state}, ${drill.regime}, ${drill.weight_on_bit} N on the bit, ${faults}`;
}

async function look() {
  try {
    const { domain, drills } = await (await fetch("drills")).json();
    said.textContent = drills.length
      ? `${drills.length} in ROS domain ${domain}`
      : `There is no drill in ROS domain ${domain}. "rpud run" starts one; it then appears here.`;
    const now = JSON.stringify(drills.map((/** @type {any} */ drill) => drill.path));
    if (now !== before) {
      before = now;
      list.replaceChildren(...drills.map((/** @type {any} */ drill) => {
        const item = document.createElement("li");
        const link = item.appendChild(document.createElement("a"));
        link.href = drill.path;
        link.appendChild(document.createElement("b")).textContent = drill.namespace;
        link.appendChild(document.createElement("span"));
        return item;
      }));
    }
    list.querySelectorAll("span").forEach((span, place) => { span.textContent = describe(drills[place]); });
  } catch {
    said.textContent = "The server of this page has gone.";
  }
  setTimeout(look, 1500);
}
look();
