"""A robot arm in MuJoCo presses the drill into two layers of rock, meets a jam and lets go.

    pip install mujoco matplotlib rpud_sim
    python press.py

Both simulators advance by the same step. In each one

1. the place of the mount along the drill axis goes from MuJoCo to the drill;
2. the drill advances, with a mount that is carried to this place;
3. the mean force and the torque on the mount in this step go to MuJoCo, which then advances.

So force and motion belong to the same step, and the place of the mount is one step old.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from matplotlib.figure import Figure

import rpud_sim

STEP = 0.001  # of the exchange [s]
SURFACE = 0.2665  # height of the mount at which the tool just touches the rock [m]
WEIGHT, RETREAT = 20.0, -15.0  # force of the arm along the drill axis, toward the rock [N]
ABOVE = -0.004  # place at which it waits after a jam [m]
SILENCE = 0.3  # without an impact, which is a jam [s]
CHALK = 0.0025  # depth at which the limestone begins [m]
LAYERS = [{"depth_from": 0.0, "rock": "chalk"}, {"depth_from": CHALK, "rock": "limestone"}]


class Arm:
    """Planar arm with four joints: an impedance across the drill axis, a force along it."""

    def __init__(self, step: float = STEP) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("arm.xml")))
        self.model.opt.timestep = step
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = -0.45, 0.9, 0.4, 0.72  # the mount is above the rock, and looks down
        mujoco.mj_forward(self.model, self.data)
        self.torques = np.zeros(4)  # of the joints [N m]
        self._x = float(self.data.site("mount").xpos[0])  # that it keeps [m]

    @property
    def place(self) -> float:
        """Place of the mount along the drill axis; zero where the tool touches the rock [m]."""
        return SURFACE - float(self.data.site("mount").xpos[2])

    def step(self, weight: float, force: float, torque: float) -> None:
        """Press with a weight [N], under force [N] and torque [N m] of the drill on the mount."""
        model, data, site = self.model, self.data, self.data.site("mount")
        jacobian, turning = np.zeros((3, 4)), np.zeros((3, 4))
        mujoco.mj_jacSite(model, data, jacobian, turning, model.site("mount").id)
        speed, rate = jacobian @ data.qvel, turning @ data.qvel
        pitch = np.arctan2(-site.xmat[6], site.xmat[0]) - np.pi / 2  # off the drill axis [rad]
        push = np.array([4000.0 * (self._x - site.xpos[0]) - 200.0 * speed[0], 0.0, -weight])
        push[2] -= 400.0 * speed[2]
        turn = np.array([0.0, -80.0 * pitch - 8.0 * rate[1], 0.0])
        self.torques = data.qfrc_bias + jacobian.T @ push + turning.T @ turn - 0.5 * data.qvel
        drill = np.array([0.0, 0.0, force]), np.array([0.0, 0.0, -torque])
        data.qfrc_applied[:] = self.torques + jacobian.T @ drill[0] + turning.T @ drill[1]
        mujoco.mj_step(model, data)


def fly(duration: float = 20.0, jam: float = 15.0, step: float = STEP) -> dict[str, np.ndarray]:
    """Drill, with a jam after some seconds; return what happened in each step, by name."""
    arm = Arm(step)
    drill = rpud_sim.Drill(
        # The arm is MuJoCo's: the drill's own carries the mount rigidly to the place it is given.
        feed_model="arm",
        arm_stiffness=0.0,
        anchoring_force=1000.0,
        feed_rate_limit=1.0,
        initial_feed=arm.place,
        rotation_model="friction_drive",
        strata=str({"layers": LAYERS}),
    )
    rows: list[tuple[float, ...]] = []
    weight, impacts, struck = WEIGHT, 0, np.inf
    for number in range(round(duration / step)):
        if number == round(jam / step):
            drill.inject("free_mass_jammed")
        drill.feed(position=arm.place)
        time = drill.step(step)
        status = drill.status
        if status.impacts > impacts and status.depth > 0.0:
            struck = time
        impacts = status.impacts
        if time - struck > SILENCE:  # it lets go, and stops above the rock
            weight = RETREAT if arm.place > ABOVE else 0.0
        force = drill.reacting_force
        arm.step(weight, force, drill.torque)
        rows.append((time, arm.place, force, status.depth, impacts, *arm.torques))
    names = ("time", "place", "reacting_force", "depth", "impacts", *("shoulder", "elbow"))
    return dict(zip((*names, "forearm", "wrist"), np.array(rows).T, strict=True))


def plot(flight: dict[str, np.ndarray]) -> Figure:
    """Return a figure of reacting force, joint torques and depth."""
    figure = Figure(figsize=(9, 7), layout="constrained")
    force, torques, depth = figure.subplots(3, sharex=True)
    force.plot(flight["time"], flight["reacting_force"], lw=0.5)
    force.set_ylabel("reacting force [N]")
    for name in ("shoulder", "elbow", "forearm", "wrist"):
        torques.plot(flight["time"], flight[name], lw=0.7, label=name)
    torques.set_ylabel("joint torque [N m]")
    torques.legend(loc="upper right", ncols=4)
    depth.plot(flight["time"], 1e3 * flight["depth"], label="hole")
    depth.axhline(1e3 * CHALK, color="gray", ls=":", label="limestone")
    depth.set_ylabel("depth [mm]")
    depth.set_xlabel("time [s]")
    depth.legend()
    return figure


if __name__ == "__main__":
    flown = fly()
    plot(flown).savefig("mujoco_arm.png", dpi=100)
    print(f"hole {1e3 * flown['depth'][-1]:.2f} mm, {flown['impacts'][-1]:.0f} impacts")
    print(f"mount at the end {1e3 * flown['place'][-1]:.1f} mm; mujoco_arm.png written")
