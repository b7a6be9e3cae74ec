"""The drill by SciPy: `solve_ivp` from one collision to the next, as its documentation shows."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from bench.flight import Bodies
from rpud_sim.model.collision import collide
from rpud_sim.model.drill import derive
from rpud_sim.simulation import Parameters

STEPS_PER_CYCLE = 8  # events are seen between steps, so that these bound what is missed


def impact_times(
    parameters: Parameters, bodies: Bodies, phase: float, duration: float
) -> np.ndarray:
    """Return the times of the impacts on the drill tool [s], from a state with the mass in flight.

    Args:
        parameters: of the drill.
        bodies: at time zero; in the rock the drill tool rests.
        phase: of the vibration at time zero [cycles].
        duration: to simulate [s].
    """
    drill = derive(parameters)
    amplitude, frequency = parameters.vibration_amplitude, parameters.vibration_frequency
    omega = 2.0 * math.pi * frequency
    together_mass = drill.free_mass + drill.tool_mass
    together = False

    def motion(time, y):
        u_np, v_np, _, v_fm, u_dt, v_dt = y
        a_np = parameters.weight_on_bit - drill.load_spring_rate * u_np - drill.rpud_damping * v_np
        a_fm = drill.gravity
        a_dt = 0.0
        if together:
            a_dt = (drill.free_mass * a_fm - drill.tool_spring_rate * u_dt) / together_mass
            a_fm = a_dt
        elif not drill.in_rock:
            a_dt = -(drill.tool_spring_rate * u_dt + drill.tool_damping * v_dt) / drill.tool_mass
        return v_np, a_np / drill.rpud_mass, v_fm, a_fm, v_dt, a_dt

    def tip_gap(time, y):
        return y[2] - y[0] - amplitude * math.sin(omega * time + 2.0 * math.pi * phase)

    def tool_gap(time, y):
        return y[4] - y[2]

    def contact_force(time, y):
        a_dt = (drill.free_mass * drill.gravity - drill.tool_spring_rate * y[4]) / together_mass
        return drill.gravity - a_dt

    for event in (tip_gap, tool_gap, contact_force):
        event.terminal = True  # type: ignore[attr-defined]
        event.direction = -1.0  # type: ignore[attr-defined]

    times = []
    time = 0.0
    y = list(bodies)
    while time < duration:
        solution = solve_ivp(
            motion,
            (time, duration),
            y,
            method="DOP853",
            events=(tip_gap, contact_force if together else tool_gap),
            max_step=1.0 / (STEPS_PER_CYCLE * frequency),
            rtol=1e-10,
            atol=1e-13,
        )
        time = solution.t[-1]
        y = [float(value) for value in solution.y[:, -1]]
        if solution.status != 1:
            break
        v_hv = omega * amplitude * math.cos(omega * time + 2.0 * math.pi * phase)
        struck = False
        if len(solution.t_events[0]):
            y[2] -= tip_gap(time, y)
            v_ut, y[3] = collide(
                drill.rpud_mass, y[1] + v_hv, drill.free_mass, y[3], drill.actuator_restitution
            )
            y[1] = v_ut - v_hv
            struck = together
        elif together:
            together = False
            y[4] = y[5] = 0.0
        else:
            struck = True
        if struck:
            times.append(time)
            restitution = 0.0 if drill.in_rock else drill.drill_tool_restitution
            y[3], y[5] = collide(drill.free_mass, y[3], drill.tool_mass, y[5], restitution)
            together = drill.in_rock
            y[2] = y[4]
    return np.array(times)
