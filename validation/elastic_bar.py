"""Elastic bar instead of the drill tool: a reference for the energy balance, eqs. (20)-(39).

The stepped bar obeys the one-dimensional wave equation

    rho A u_tt = (E A u_x)_x,   0 < x < L_dt1 + L_dt2,   u = 0 at the rock

and the rigid free mass strikes its upper end, x = 0, with unilateral contact. In space: linear
finite elements with lumped masses, all of one length. The contact is a spring as stiff as one
element of part I, so that mesh and contact become rigid together. In time: SciPy's ``DOP853``.

With a finer mesh displacement and time of contact converge. The peak of the contact force does not,
and the restitution only slowly: it comes from the exact waves, by the method of characteristics.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.integrate import solve_ivp

from rpud_sim.model.contact import single_contact
from rpud_sim.model.contact_models import CONTACT_MODELS
from rpud_sim.simulation import Parameters, preset
from validation.numbers import CONTACT_SPEED, gather

FREE_MASSES = (1e-3, 2e-3, 5e-3, 10e-3, 20e-3, 50e-3)  # [kg]
WAVE_STEPS = 800  # of time, in which a wave passes through part I

# The mass has left the bar after this share of the slowest period of both together.
_HORIZON = 0.9


@dataclasses.dataclass(frozen=True)
class BarImpact:
    """Result of one blow of the free mass on the bar."""

    peak_displacement: float  # of the bar's upper end [m]
    duration: float  # from the first touch to the last [s]
    restitution: float  # velocity of the free mass after the last touch over that before the first
    impulse: float = 0.0  # of the contact force [N s]
    energy_error: float = 0.0  # change of the total energy over the initial energy


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Results of one blow at 5 m/s by the bar and by the energy balance."""

    free_mass: float  # [kg]
    bar: BarImpact  # with the restitution by the exact waves
    balances: dict[str, BarImpact]  # by contact model


def compare_with_bar(elements: int) -> list[Comparison]:
    """Return a comparison for each of ``FREE_MASSES``."""
    drills = [preset("drilling").replace(free_mass=mass) for mass in FREE_MASSES]
    bars = gather(strike, [(drill, CONTACT_SPEED, elements) for drill in drills], "elastic bar")
    found = []
    for drill, bar in zip(drills, bars, strict=True):
        bar = dataclasses.replace(bar, restitution=strike_by_waves(drill, CONTACT_SPEED)[0])
        balances = {model: _balance(drill, model) for model in CONTACT_MODELS}
        found.append(Comparison(drill.free_mass, bar, balances))
    return found


def _balance(drill: Parameters, model: str) -> BarImpact:
    """Return the same blow by the energy balance.

    After (39) the free mass leaves the tool with the velocity that both had after (21).
    """
    contact = single_contact(drill.replace(contact_model=model), CONTACT_SPEED)
    restitution = contact.velocity / CONTACT_SPEED
    return BarImpact(contact.peak_displacement, contact.duration, restitution)


def strike(parameters: Parameters, impact_velocity: float, elements: int = 10) -> BarImpact:
    """Return the result of a blow of the free mass on the resting bar.

    Args:
        parameters: of the drill; the contact model has no effect.
        impact_velocity: of the free mass [m/s].
        elements: number of elements in part I; those in part II have about the same length.
    """
    masses, springs, contact_rate = _mesh(parameters, elements)
    count = len(masses)
    free_mass, gravity = parameters.free_mass, parameters.gravity

    def derivative(_: float, state: np.ndarray) -> np.ndarray:
        # state: positions of nodes and mass, then velocities, then the impulse of the contact
        force = contact_rate * max(state[count] - state[0], 0.0)
        pushes = np.concatenate([[force], -springs * np.diff(state[:count], append=0.0)])
        ends = [gravity - force / free_mass, force]
        return np.concatenate([state[count + 1 : -1], -np.diff(pushes) / masses, ends])

    def energy(state: np.ndarray) -> float:
        squeeze = max(state[count] - state[0], 0.0)
        return float(
            0.5 * np.sum(springs * np.diff(state[:count], append=0.0) ** 2)
            + 0.5 * np.sum(masses * state[count + 1 : -2] ** 2)
            + 0.5 * free_mass * state[-2] ** 2
            - free_mass * gravity * state[count]
            + 0.5 * contact_rate * squeeze**2
        )

    start = np.zeros(2 * count + 3)
    start[-2] = impact_velocity
    stop = _HORIZON * _slowest_period(parameters)
    solution = solve_ivp(
        derivative, (0.0, stop), start, "DOP853", rtol=1e-7, atol=1e-10 * impact_velocity * stop
    )
    state = solution.y
    touches = np.flatnonzero(state[count] > state[0])
    end = float(solution.t[min(touches[-1] + 1, len(solution.t) - 1)])
    final = state[:, -1]
    return BarImpact(
        peak_displacement=float(state[0].max()),
        duration=end,
        restitution=float(-(final[-2] - gravity * (stop - end)) / impact_velocity),
        impulse=float(final[-1]),
        energy_error=energy(final) / energy(start) - 1.0,
    )


def strike_by_waves(
    parameters: Parameters, impact_velocity: float, steps: int = WAVE_STEPS
) -> tuple[float, float]:
    """Return restitution and greatest displacement [m] of the same blow, without gravity.

    Waves pass through both sections unchanged and are split at the step between them; the mass is
    integrated implicitly.
    """
    mass, modulus = parameters.free_mass, parameters.elastic_modulus
    wave_speed = np.sqrt(modulus / parameters.drill_tool_density)
    step = parameters.section_1_length / wave_speed / steps
    # Wave impedance [N s/m]
    upper = parameters.section_1_area * np.sqrt(modulus * parameters.drill_tool_density)
    lower = parameters.section_2_area * np.sqrt(modulus * parameters.drill_tool_density)
    reflected = (upper - lower) / (upper + lower)
    rest = round(parameters.section_2_length / wave_speed / step)
    # velocities of the waves, by place
    down_1, up_1, down_2, up_2 = (np.zeros(count) for count in (steps, steps, rest, rest))
    velocity, mass_position, tip_position, touching, greatest = impact_velocity, 0.0, 0.0, True, 0.0
    for _ in range(int(_HORIZON * _slowest_period(parameters) / step)):
        arriving, at_step, at_rock, from_rock = up_1[0], down_1[-1], down_2[-1], up_2[0]
        down_1, down_2 = np.roll(down_1, 1), np.roll(down_2, 1)
        up_1, up_2 = np.roll(up_1, -1), np.roll(up_2, -1)
        up_1[-1] = reflected * at_step + (1.0 - reflected) * from_rock
        down_2[0] = (1.0 + reflected) * at_step - reflected * from_rock
        up_2[-1] = -at_rock
        force = 0.0
        if touching:
            pushed = mass * velocity + 2.0 * step * upper * arriving
            force = max(upper * (pushed / (mass + upper * step) - 2.0 * arriving), 0.0)
            touching = force > 0.0
        velocity -= force * step / mass
        tip_velocity = 2.0 * arriving + force / upper
        down_1[0] = tip_velocity - arriving
        mass_position += velocity * step
        tip_position += tip_velocity * step
        touching = touching or mass_position >= tip_position
        mass_position = min(mass_position, tip_position)
        greatest = max(greatest, tip_position)
    return float(-velocity / impact_velocity), float(greatest)


def _mesh(parameters: Parameters, elements: int) -> tuple[np.ndarray, np.ndarray, float]:
    length = parameters.section_1_length / elements
    rest = max(round(parameters.section_2_length / length), 1)
    area = np.repeat([parameters.section_1_area, parameters.section_2_area], [elements, rest])
    lengths = np.repeat([length, parameters.section_2_length / rest], [elements, rest])
    springs = parameters.elastic_modulus * area / lengths
    pieces = parameters.drill_tool_density * area * lengths
    masses = 0.5 * pieces
    masses[1:] += 0.5 * pieces[:-1]
    return masses, springs, float(springs[0])


def _slowest_period(parameters: Parameters) -> float:
    masses, springs, _ = _mesh(parameters, 4)
    stiffness = np.diag(springs + np.concatenate([[0.0], springs[:-1]]))
    stiffness -= np.diag(springs[:-1], 1) + np.diag(springs[:-1], -1)
    masses[0] += parameters.free_mass
    root = np.sqrt(masses)
    least = np.linalg.eigvalsh(stiffness / np.outer(root, root))[0]
    return 2.0 * np.pi / float(np.sqrt(least))
