"""A robot arm in MuJoCo presses the drill into two layers of rock, meets a jam and lets go.

    python press.py [SECONDS]

prints the depth, and where the time goes. README.md shows how both exchange motion and force.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

import rpud_sim

STEP = 0.001  # of the exchange [s]
SURFACE = 0.2665  # height of the mount at which the tool just touches the rock [m]
WEIGHT, RETREAT = 20.0, -15.0  # force of the arm along the drill axis, toward the rock [N]
ABOVE, HOLD = -0.02, 3000.0  # place at which it waits after a jam [m], and how stiffly [N/m]
JAM = 15.0  # time of the jam [s]
SILENCE = 0.3  # without an impact, which is a jam [s]
CHALK = 0.0025  # depth at which the limestone begins [m]
JOINTS = ("shoulder", "elbow", "forearm", "wrist")
# What the drill is: its mount is carried by another simulator.
DRILL = {
    "feed_model": "given",
    "feed_rate_limit": 1.0,
    "rotation_model": "friction_drive",
    "strata": f"{{layers: [{{depth_from: 0, rock: chalk}}, "
    f"{{depth_from: {CHALK}, rock: limestone}}]}}",
}


class Arm:
    """Planar arm with four joints: an impedance across the drill axis, a force along it."""

    def __init__(self, step: float = STEP) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("arm.xml")))
        self.model.opt.timestep = step
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = -0.45, 0.9, 0.4, 0.72  # the mount is above the rock, and looks down
        self.torques = np.zeros(4)  # of the joints [N m]
        self._ahead = 0.0  # part of the force on the mount that was taken before it came [N]
        self._jacobian, self._turning = np.zeros((3, 4)), np.zeros((3, 4))
        self._look()
        self._x = float(self._site.xpos[0])  # that it keeps [m]

    def _look(self) -> None:
        """Compute what follows from the positions and velocities of the joints."""
        mujoco.mj_step1(self.model, self.data)
        self._site = self.data.site("mount")
        mujoco.mj_jacSite(self.model, self.data, self._jacobian, self._turning, self._site.id)

    @property
    def place(self) -> float:
        """Place of the mount along the drill axis; zero where the tool touches the rock [m]."""
        return SURFACE - float(self._site.xpos[2])

    @property
    def rate(self) -> float:
        """Rate of this place, toward the rock [m/s]."""
        return -float(self._jacobian[2] @ self.data.qvel)

    def step(self, weight: float, answer: Answer) -> None:
        """Press with a weight [N], under force and torque of the drill on the mount.

        Within the step the force follows the mount by the drill's stiffness and damping. What was
        taken ahead so is taken off in the next step, whose force has it: no momentum is lost.
        """
        place, jacobian, turning = self._site, self._jacobian, self._turning
        speed, rate = jacobian @ self.data.qvel, turning @ self.data.qvel
        pitch = np.arctan2(-place.xmat[6], place.xmat[0]) - np.pi / 2  # off the drill axis [rad]
        push = np.array([4000.0 * (self._x - place.xpos[0]) - 200.0 * speed[0], 0.0, -weight])
        push[2] -= 400.0 * speed[2]
        turn = np.array([0.0, -80.0 * pitch - 8.0 * rate[1], 0.0])
        self.torques = self.data.qfrc_bias + push @ jacobian + turn @ turning
        self.torques -= 0.5 * self.data.qvel
        axis, step = -jacobian[2], self.model.opt.timestep
        applied = self.torques - answer.torque * turning[2]
        applied -= (answer.reacting_force - self._ahead) * axis
        smooth = self.data.qfrc_passive - self.data.qfrc_bias + applied
        moved = np.zeros((2, 4))  # accelerations under all forces, and under one along the axis
        mujoco.mj_solveM(self.model, self.data, moved, np.array([smooth, axis]))
        follows = (answer.damping + answer.stiffness * step) * step
        self._ahead = follows * (axis @ moved[0]) / (1.0 + follows * (axis @ moved[1]))
        self.data.qfrc_applied[:] = applied - self._ahead * axis
        mujoco.mj_step2(self.model, self.data)
        self._look()


class Answer(NamedTuple):
    """Answer of the drill at the end of a step."""

    time: float  # [s]
    reacting_force: float  # on the mount, away from the rock [N]
    torque: float  # on the mount, about the axis toward the rock [N m]
    impacts: int  # on the drill tool so far
    depth: float  # of the hole [m]
    stiffness: float  # of the drill at its mount [N/m]
    damping: float  # of the drill at its mount [N s/m]


# Takes place [m] and rate [m/s] of the mount at the beginning of a step.
Exchange = Callable[[float, float], Answer]


def drill_here(start: float, step: float = STEP, jam: float = JAM) -> Exchange:
    """Return the exchange with a drill in this process, from a place of the mount on [m]."""
    drill = rpud_sim.Drill(**DRILL, initial_feed=start)

    def exchange(place: float, rate: float) -> Answer:
        if abs(drill.time - jam) < 0.5 * step:
            drill.inject("free_mass_jammed")
        drill.move(place, rate)
        now, status = drill.step(step), drill.status
        loads = drill.reacting_force, drill.torque
        return Answer(now, *loads, status.impacts, status.depth, *drill.mount_impedance)

    return exchange


def fly(arm: Arm, exchange: Exchange, duration: float = 20.0) -> dict[str, np.ndarray]:
    """Drill, and let go of a jam; return what happened in each step, by name."""
    rows: list[tuple[float, ...]] = []
    weight, last, struck, waited = WEIGHT, 0, np.inf, 0.0
    for _ in range(round(duration / arm.model.opt.timestep)):
        place, asked = arm.place, time.perf_counter()
        answer = exchange(place, arm.rate)
        waited += time.perf_counter() - asked
        if answer.impacts > last and answer.depth > 0.0:
            struck = answer.time
        last = answer.impacts
        if answer.time - struck > SILENCE:  # it lets go, and waits above the rock
            weight = max(RETREAT, HOLD * (ABOVE - place))
        arm.step(weight, answer)
        rows.append((*answer, arm.place, waited, *arm.data.qpos, *arm.torques))
    names = (*Answer._fields, "place", "waited", *(f"{name}_angle" for name in JOINTS), *JOINTS)
    return dict(zip(names, np.array(rows).T, strict=True))


if __name__ == "__main__":
    duration = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    arm = Arm()
    exchange = drill_here(arm.place, jam=0.75 * duration)
    begun, worked = time.perf_counter(), time.process_time()
    flown = fly(arm, exchange, duration)
    took, worked = time.perf_counter() - begun, time.process_time() - worked
    share = flown["waited"][-1] / took
    print(f"hole {1e3 * flown['depth'][-1]:.2f} mm, {flown['impacts'][-1]:.0f} impacts")
    print(f"{duration:g} s took {worked:.1f} s of a core: {share:.0%} drill, {1 - share:.0%} arm")
