"""The drill by MuJoCo: sliding bodies with contacts, at a fixed time step.

The vibration is a joint between nodal plane and tip, on a rotor so heavy that no blow disturbs it.
A contact is a damper that turns the closing velocity around, or takes it away, within one step;
this needs the coarsest steps for an elastic collision. In the rock the drill tool is the effective
mass on its spring, which a limit without rebound holds back from stretching.
"""

from __future__ import annotations

import math
import time

import mujoco
import numpy as np
from mujoco import rollout

from rpud_sim.model.drill import derive
from rpud_sim.simulation import Parameters

# The coarsest steps, by halving, that keep impact rate, impact velocity and contact force within
# 3 % [s].
TIME_STEPS = {"drilling": 1e-6, "free": 4e-6}

SLOWEST_BLOW = 0.1  # blows below are part of a contact that lasts, and not counted [m/s]
ROTOR = 1e6  # [kg]
CHUNK = 200_000  # steps whose states are kept at a time
_IMPEDANCE = 'solimp="0.9999 0.9999 0.001 0.5 2"'


def _model(parameters: Parameters, step: float) -> str:
    drill = derive(parameters)
    omega = 2.0 * math.pi * parameters.vibration_frequency
    limit = ""
    if drill.in_rock:
        limit = f'limited="true" range="0 1" solreflimit="0 {-1.0 / step}" ' + (
            _IMPEDANCE.replace("solimp", "solimplimit")
        )
    on_tip = -(1.0 + drill.actuator_restitution) / step
    on_tool = -(1.0 + (0.0 if drill.in_rock else drill.drill_tool_restitution)) / step
    return f"""
<mujoco>
  <compiler autolimits="false"/>
  <option timestep="{step}" gravity="0 0 {drill.gravity}" integrator="Euler" solver="Newton"/>
  <default><geom type="sphere" size="0.01" contype="0" conaffinity="0"/>
    <joint type="slide" axis="0 0 1"/></default>
  <worldbody>
    <body gravcomp="1">
      <joint stiffness="{drill.load_spring_rate}" damping="{drill.rpud_damping}"
             springref="{parameters.weight_on_bit / drill.load_spring_rate}"/>
      <inertial mass="{drill.rpud_mass}" pos="0 0 0" diaginertia="1 1 1"/>
      <body gravcomp="1">
        <joint armature="{ROTOR}" stiffness="{omega * omega * ROTOR}"/>
        <geom name="tip" mass="1e-9" pos="0 0 -0.02"/>
      </body>
    </body>
    <body><joint/><geom name="mass" mass="{drill.free_mass}"/></body>
    <body gravcomp="1">
      <joint stiffness="{drill.tool_spring_rate}" damping="{drill.tool_damping}" {limit}/>
      <geom name="tool" mass="{drill.tool_mass}" pos="0 0 0.02"/>
    </body>
  </worldbody>
  <contact>
    <pair geom1="tip" geom2="mass" condim="1" solref="0 {on_tip}" {_IMPEDANCE}/>
    <pair geom1="mass" geom2="tool" condim="1" solref="0 {on_tool}" {_IMPEDANCE}/>
  </contact>
</mujoco>"""


class DrillInMujoco:
    """One drill from time zero on; `advance` adds to its figures.

    Args:
        parameters: of the drill.
        step: time step [s].
    """

    def __init__(self, parameters: Parameters, step: float) -> None:
        self._drill = derive(parameters)
        self._weight_on_bit = parameters.weight_on_bit
        self.step = step
        self._model = mujoco.MjModel.from_xml_string(_model(parameters, step))
        self._data = mujoco.MjData(self._model)
        omega = 2.0 * math.pi * parameters.vibration_frequency
        self._data.qvel[1] = omega * parameters.vibration_amplitude
        self._state = np.empty(
            mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        )
        mujoco.mj_getState(
            self._model, self._data, self._state, mujoco.mjtState.mjSTATE_FULLPHYSICS
        )
        self._duration = 0.0
        self._speeds: list[float] = []
        self._forces: list[float] = []
        self._reacting_impulse = 0.0

    def advance(self, duration: float) -> float:
        """Simulate further [s]; returns the processor time of MuJoCo alone [s]."""
        used = 0.0
        left = round(duration / self.step)
        while left:
            steps = min(left, CHUNK)
            began = time.process_time()
            states, _ = rollout.rollout(
                self._model, self._data, initial_state=self._state[None], nstep=steps
            )
            used += time.process_time() - began
            self._state = states[0, -1].copy()
            self._count(states[0, :, 1:5], states[0, :, 5:9])
            left -= steps
        return used

    def _count(self, positions: np.ndarray, velocities: np.ndarray) -> None:
        drill = self._drill
        u_np, _, u_fm, u_dt = positions.T
        v_np, _, v_fm, v_dt = velocities.T
        closed = u_dt <= u_fm
        begun = np.flatnonzero(closed[1:] & ~closed[:-1])
        begun = begun[v_fm[begun] - v_dt[begun] > SLOWEST_BLOW]
        self._speeds.extend(v_fm[begun] - v_dt[begun])
        if drill.in_rock:
            mass = drill.free_mass + drill.tool_mass
            longest = round(2.0 * math.pi * math.sqrt(mass / drill.tool_spring_rate) / self.step)
            weight = drill.free_mass * drill.gravity
            for first in begun:
                elastic = drill.tool_spring_rate * u_dt[first : first + longest + 1].max()
                # Eqs. (30) and (31).
                self._forces.append(weight + drill.free_mass / mass * (elastic - weight))
        force = self._weight_on_bit - drill.load_spring_rate * u_np - drill.rpud_damping * v_np
        self._reacting_impulse += float(force.sum()) * self.step
        self._duration += len(u_np) * self.step

    def figures(self) -> dict[str, float]:
        """Return the figures so far by the names of `rpud simulate`."""
        return {
            "drill_tool_impact_rate": len(self._speeds) / self._duration,
            "impact_velocity_mean": float(np.mean(self._speeds)),
            "contact_force_mean": float(np.mean(self._forces)) if self._forces else math.nan,
            "reacting_force_mean": self._reacting_impulse / self._duration,
        }
