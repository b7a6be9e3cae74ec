"""Conditions of the drill and its rock under faults, and the faults that it can honour."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

from rpud_sim.drilling.inputs import UNDISTURBED, Disturbances
from rpud_sim.drilling.rock import Strata
from rpud_sim.model.parameters import QUANTITIES, Parameters
from rpud_sim.simulation.channels import CHANNELS
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.faults import KINDS, Fault, FaultError

# A binding raises the damping ratio up to this. The closed forms of the paper need less than
# critical damping, which is 1.
MOST_DAMPING_RATIO = 0.99


# Field of ``Disturbances`` that a kind sets to its magnitude.
_DISTURBED_BY = {
    "binding": "extra_torque",
    "hard_inclusion": "inclusion_strength",
    "corkscrewing": "screw_torque",
    "bit_walk": "side_walk",
    "feed_stall": "feed_stalled",
    "arm_slip": "arm_slip_rate",
    "worn_bit": "worn_factor",
}
# Kinds that need a rotation, a hole and a feed.
_TURNING = ("binding", "corkscrewing")
_DRILLED = (*_TURNING, "hard_inclusion", "bit_walk", "worn_bit")
_FED = ("feed_stall", "arm_slip")


@dataclasses.dataclass(frozen=True)
class Conditions:
    """Drill and rock under faults."""

    parameters: Parameters  # in force, always inside their ranges
    jammed: bool = False  # whether the free mass is wedged to the drill tool
    specific_energy_factor: float = 1.0  # on the specific energy of the rock
    progress_factor: float = 1.0  # on the progress into the rock, 0 to 1
    resonance_offset: float = 0.0  # of the actuator [Hz]
    preload_factor: float = 1.0  # on the commanded weight on bit, 0 to 1
    lock_lost: bool = False  # whether a tracking generator does not track
    disturbances: Disturbances = UNDISTURBED  # of the slow processes around the percussion
    # k_1 without a binding, with which the load spring pushes [N/m]; that of the parameters
    # if not given
    load_spring_rate: float = math.nan

    def __post_init__(self) -> None:
        if math.isnan(self.load_spring_rate):
            object.__setattr__(self, "load_spring_rate", self.parameters.load_spring_rate)


def conditions(parameters: Parameters, faults: Iterable[Fault]) -> Conditions:
    """Return the conditions under any faults; signal faults do not change the drill.

    Factors of several faults multiply and offsets add, so that their order does not matter. A
    binding by a factor f means that the same force moves a body 1/f as far, and takes the damping
    ratio xi to 1 - (1 - xi)/f, up to ``MOST_DAMPING_RATIO`` (assumed). A parameter that would leave
    its range takes the end of the range.
    """
    jammed = lock_lost = False
    load_spring = restoring_spring = restitution = drill_tool_restitution = 1.0
    specific_energy = progress = binding = clearing = preload = 1.0
    offset = 0.0
    slow = UNDISTURBED
    for fault in faults:
        magnitude = fault.magnitude
        if fault.kind == "free_mass_jammed":
            jammed = True
        elif fault.kind == "generator_lock_loss":
            lock_lost = True
        elif fault.kind == "lost_preload":
            preload *= 1.0 - magnitude
        elif fault.kind == "load_spring_binding":
            load_spring *= magnitude
        elif fault.kind == "drill_tool_binding":
            restoring_spring *= magnitude
            progress /= magnitude
            binding /= magnitude
        elif fault.kind == "choking":
            progress *= 1.0 - magnitude
            clearing *= 1.0 - magnitude
            drill_tool_restitution *= 1.0 - magnitude
        elif fault.kind == "hard_rock":
            specific_energy *= magnitude
        elif fault.kind == "resonance_drift":
            offset += magnitude
        elif fault.kind == "restitution_loss":
            restitution *= magnitude
        else:
            slow = _disturbed(slow, fault)
    wanted = {
        "load_spring_rate": parameters.load_spring_rate * load_spring,
        "rpud_damping_ratio": _bound(parameters.rpud_damping_ratio, load_spring),
        "restoring_spring_rate": parameters.restoring_spring_rate * restoring_spring,
        "drill_tool_damping_ratio": _bound(parameters.drill_tool_damping_ratio, restoring_spring),
        "actuator_restitution": parameters.actuator_restitution * restitution,
        "drill_tool_restitution": parameters.drill_tool_restitution
        * restitution
        * drill_tool_restitution,
    }
    limited = {name: min(value, _greatest(parameters, name)) for name, value in wanted.items()}
    return Conditions(
        parameters=parameters.replace(**limited),
        load_spring_rate=parameters.load_spring_rate,
        jammed=jammed,
        specific_energy_factor=specific_energy,
        progress_factor=progress,
        resonance_offset=offset,
        preload_factor=preload,
        lock_lost=lock_lost,
        disturbances=dataclasses.replace(
            slow,
            hardness=specific_energy,
            progress=binding,
            clearing=clearing,
            clogged=1.0 - clearing,
            preload_factor=preload,
        ),
    )


def _disturbed(disturbances: Disturbances, fault: Fault) -> Disturbances:
    """Return disturbances with those of one more fault of the slow processes; others add none."""
    field = _DISTURBED_BY.get(fault.kind)
    if field is None:
        return disturbances
    value = True if KINDS[fault.kind].magnitude is None else fault.magnitude
    return dataclasses.replace(disturbances, **{field: max(getattr(disturbances, field), value)})


def _bound(damping_ratio: float, factor: float) -> float:
    return damping_ratio if factor == 1.0 else 1.0 - (1.0 - damping_ratio) / factor


def _greatest(parameters: Parameters, name: str) -> float:
    if name.endswith("damping_ratio"):
        return max(MOST_DAMPING_RATIO, getattr(parameters, name))
    return QUANTITIES[name].maximum


def check_honoured(fault: Fault, configuration: Configuration) -> None:
    """Refuse a fault that would have no effect, or no meaning, in a configuration."""
    actuator = configuration.actuator
    no_rotation = configuration.rotation.rotation_model == "none"
    layers = configuration.drilling.layers
    no_rock = configuration.rock.rock_model == "none" and layers is None
    drilling = configuration.parameters.regime == "drilling"
    reason = ""
    if fault.kind == "resonance_drift":
        drifted = actuator.resonance_frequency + fault.magnitude
        allowed = QUANTITIES["vibration_frequency"]
        if actuator.actuator_model != "resonance":
            reason = f"needs actuator_model = resonance, which is {actuator.actuator_model}"
        elif not allowed.minimum <= drifted <= allowed.maximum:
            reason = f"takes the resonance to {drifted:g} Hz, outside its range {allowed.range}"
    elif fault.kind == "generator_lock_loss" and actuator.generator != "tracking":
        reason = f"needs generator = tracking, which is {actuator.generator}"
    elif no_rock and fault.kind in ("hard_rock", "choking"):
        reason = "needs a rock_model, which is none, or strata"
    elif no_rock and drilling and fault.kind == "drill_tool_binding":
        reason = (
            "acts on the progress while drilling and needs a rock_model, which is none, or strata"
        )
    elif no_rotation and (fault.kind in _TURNING or fault.channel == "rotation"):
        reason = "needs a rotation_model, which is none"
    elif not configuration.has_feed and (fault.kind in _FED or fault.channel == "mount"):
        reason = "needs a feed_model, which is none"
    elif fault.kind in _DRILLED:
        reason = _lacking_rock(fault, layers, no_rotation)
    if reason:
        raise FaultError(f"{fault} cannot be honoured: it {reason}")


def _lacking_rock(fault: Fault, layers: Strata | None, no_rotation: bool) -> str:
    """Return why a fault of the hole would have no effect; empty if it has one."""
    if layers is None:
        return "needs strata, or a rotation_model with a rock_model"
    if fault.kind == "hard_inclusion":
        softest = min(layer.strength for layer in layers.layers)
        if fault.magnitude <= softest:
            return f"is not harder than any layer: the softest has a strength of {softest:g} Pa"
    blows_all_count = not any(layer.threshold_energy for layer in layers.layers)
    if fault.kind == "worn_bit" and no_rotation and blows_all_count:
        return "needs a rotation_model, or strata with a threshold_energy"
    return ""


def honoured_kinds(configuration: Configuration) -> tuple[str, ...]:
    """Return the kinds of faults that a configuration honours with their default magnitudes."""
    honoured = []
    for name, kind in KINDS.items():
        fault = Fault(name, "" if kind.physical else next(iter(CHANNELS)))
        try:
            check_honoured(fault, configuration)
        except FaultError:
            continue
        honoured.append(name)
    return tuple(honoured)
