"""Draw a run: the plot ``flight.png``, and the clip press.webp, which MuJoCo renders off screen.

MUJOCO_GL=egl python film.py
"""

from __future__ import annotations

import mujoco
import numpy as np
from matplotlib.figure import Figure
from PIL import Image, ImageDraw
from press import CHALK, JAM, JOINTS, STEP, Arm, drill_here, fly

FRAMES, PERIOD = 120, 0.08  # pictures of the clip, and the time that each is shown [s]
WIDTHS, HEIGHT = {"side": 300, "bit": 220}, 240  # of the views of arm and bit


def plot(flight: dict[str, np.ndarray]) -> Figure:
    """Return a figure of reacting force, joint torques and depth."""
    figure = Figure(figsize=(9, 7), layout="constrained")
    force, torques, depth = figure.subplots(3, sharex=True)
    force.plot(flight["time"], flight["reacting_force"], lw=0.5)
    force.set_ylabel("reacting force [N]")
    for name in JOINTS:
        torques.plot(flight["time"], flight[name], lw=0.7, label=name)
    torques.set_ylabel("joint torque [N m]")
    torques.legend(loc="upper right", ncols=4)
    depth.plot(flight["time"], 1e3 * flight["depth"], label="hole")
    depth.axhline(1e3 * CHALK, color="gray", ls=":", label="limestone")
    depth.set_ylabel("depth [mm]")
    depth.set_xlabel("time [s]")
    depth.legend(loc="upper left")
    return figure


def frames(arm: Arm, flight: dict[str, np.ndarray]) -> list[Image.Image]:
    """Return pictures of arm and bit at equal distances in time, each with its values below."""
    found, model = [], arm.model
    views = [(name, mujoco.Renderer(model, HEIGHT, width)) for name, width in WIDTHS.items()]
    parts = [(model.geom(name), model.geom(name).pos[0]) for name in ("drill", "tool")]
    for row in np.linspace(0, len(flight["time"]) - 1, FRAMES).astype(int):
        now = {name: float(values[row]) for name, values in flight.items()}
        arm.data.qpos[:] = [now[f"{name}_angle"] for name in JOINTS]
        for part, start in parts:  # the load spring lets the rock hold the drill back
            part.pos[0] = start + min(0.0, now["depth"] - now["place"])
        mujoco.mj_forward(model, arm.data)
        picture, left = Image.new("RGB", (sum(WIDTHS.values()), HEIGHT + 18), "white"), 0
        for name, renderer in views:
            renderer.update_scene(arm.data, name)
            picture.paste(Image.fromarray(renderer.render()), (left, 0))
            left += WIDTHS[name]
        near = flight["reacting_force"][max(0, row - 80) : row + 80].mean()
        said = f"{now['time']:4.1f} s   force {near:5.1f} N   hole {1e3 * now['depth']:4.2f} mm"
        said += "   the free mass is jammed" if now["time"] > JAM else ""
        ImageDraw.Draw(picture).text((6, HEIGHT + 3), said, "black")
        found.append(picture)
    return found


if __name__ == "__main__":
    arm = Arm(STEP)
    flown = fly(arm, drill_here(arm.place))
    plot(flown).savefig("flight.png", dpi=80)
    first, *others = frames(arm, flown)
    shown = {"duration": round(1000 * PERIOD), "loop": 0, "quality": 60, "method": 6}
    first.save("press.webp", save_all=True, append_images=others, **shown)
