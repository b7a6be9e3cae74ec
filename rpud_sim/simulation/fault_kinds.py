"""Kinds of faults of the drill and of its signals: what each is, needs and does.

A physical fault changes the drill, so that every channel shows its effect through the physics. A
signal fault changes the messages of one channel of a healthy drill. ``docs/reference/faults.md``
explains the kinds, and where the effect of a magnitude is assumed.
"""

from __future__ import annotations

import dataclasses
import math
import operator
from collections import deque
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from rpud_sim.drilling.inputs import Disturbances
from rpud_sim.drilling.mount import MountMotion
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.shown_quantities import quantity_in
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Fields
from rpud_sim.model.elementary import logarithm_one_plus, sin_cos_cycles
from rpud_sim.model.parameters import QUANTITIES, Parameters
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.topics import CHANNELS, FieldPath

# Share of the values of a garbage channel that are NaN or infinite, so that mission software meets
# them; of random bit patterns only one in two thousand is.
NOT_FINITE_SHARE = 0.1


@dataclasses.dataclass(frozen=True)
class FaultEffects(Disturbances):
    """Drill and rock under faults."""

    # active, always inside their ranges
    parameters: Parameters = dataclasses.field(default_factory=Parameters)
    pushing_rate: float = 0.0  # k_1 without a binding, with which the load spring pushes [N/m]
    jammed: bool = False  # whether the free mass is wedged to the drill tool
    preload_factor: float = 1.0  # factor on the force of the load spring, 0 to 1
    progress_factor: float = 1.0  # factor on the progress into the rock by percussion alone, 0 to 1
    resonance_offset: float = 0.0  # offset of the actuator's resonance [Hz]
    lock_lost: bool = False  # whether a tracking generator does not track


@dataclasses.dataclass
class Stage:
    """State of a fault on its channel, through which the messages of the channel pass."""

    channel: str  # one of ``CHANNELS``
    magnitude: float  # magnitude in the unit of the kind
    random: np.random.Generator
    last: Fields | None  # what the channel published before
    next: int = 0  # time of the next message of a slow channel [ns]
    # messages that are late, and when due
    waiting: deque[tuple[int, Fields]] = dataclasses.field(default_factory=deque)


# Why a fault would have no effect, or no meaning, on a drill; empty if it has. The reference shows
# the name of the function.
_Need = Callable[[float, Configuration], str]
# New value of a parameter or an effect, for the value without the fault and the magnitude.
_Effect = Callable[[Any, float], Any]
# Messages that continue, for those that come at a time [ns].
_Signal = Callable[[Stage, int, list[Fields]], list[Fields]]


@dataclasses.dataclass(frozen=True)
class FaultKind:
    """Kind of fault."""

    description: str  # one phrase
    needs: tuple[_Need, ...] = ()  # needs from the drill
    # meaning of its magnitude, None if it has none; without unit if the unit is the channel's
    magnitude: Quantity | None = None
    # magnitude of NaN; a factor on the channel's scale if the unit is the
    # channel's
    default: float = 0.0
    # magnitude inside the range that would change nothing and is rejected
    unchanging: float | None = None
    # whether the magnitude has the unit of the channel's main quantity
    in_channel_unit: bool = False
    # by name of a parameter or a field of ``FaultEffects``; a parameter that would leave its range
    # takes the end of the range
    effects: Mapping[str, _Effect] = dataclasses.field(default_factory=dict)
    signal: _Signal | None = None  # what it does to the messages of a channel

    @property
    def physical(self) -> bool:
        return self.signal is None

    def quantity_on(self, channel: str) -> Quantity | None:
        if self.magnitude is None or not self.in_channel_unit:
            return self.magnitude
        return dataclasses.replace(self.magnitude, unit=CHANNELS[channel].unit)

    def default_on(self, channel: str) -> float:
        """Return the magnitude of NaN on a channel."""
        return self.default * CHANNELS[channel].scale if self.in_channel_unit else self.default


def _resonance(magnitude: float, drill: Configuration) -> str:
    actuator, allowed = drill.actuator, QUANTITIES["vibration_frequency"]
    drifted = actuator.resonance_frequency + magnitude
    if actuator.actuator_model != "resonance":
        return f"needs actuator_model = resonance, which is {actuator.actuator_model}"
    if not allowed.minimum <= drifted <= allowed.maximum:
        return f"takes the resonance to {drifted:g} Hz, outside its range {allowed.range}"
    return ""


def _tracking(magnitude: float, drill: Configuration) -> str:
    generator = drill.actuator.generator
    return "" if generator == "tracking" else f"needs generator = tracking, which is {generator}"


def _rotation(magnitude: float, drill: Configuration) -> str:
    return "" if drill.rotates else "needs a rotation_model, which is none"


def _feed(magnitude: float, drill: Configuration) -> str:
    return "" if drill.has_feed else "needs a feed_model, which is none"


def _arm(magnitude: float, drill: Configuration) -> str:
    if drill.mount.command_type is MountMotion:
        return "needs feed_model = arm, which is given: move the mount"
    return _feed(magnitude, drill)


def _hole(magnitude: float, drill: Configuration) -> str:
    there = drill.layers is not None
    return "" if there else "needs strata, or a rotation_model with a rock_model"


def _rock(magnitude: float, drill: Configuration) -> str:
    there = drill.rock.rock_model != "none" or drill.layers is not None
    return "" if there else "needs a rock_model, which is none, or strata"


def _rock_while_drilling(magnitude: float, drill: Configuration) -> str:
    reason = _rock(magnitude, drill) if drill.parameters.regime == "drilling" else ""
    return f"acts on the progress while drilling and {reason}" if reason else ""


def _softer_rock(magnitude: float, drill: Configuration) -> str:
    layers = drill.layers
    softest = min(layer.strength for layer in layers.layers) if layers else 0.0
    if magnitude > softest:
        return ""
    return f"is not harder than any layer: the softest has a strength of {softest:g} Pa"


def _wear(magnitude: float, drill: Configuration) -> str:
    layers = drill.layers
    blows_fail = layers is not None and any(each.threshold_energy for each in layers.layers)
    if blows_fail or not _rotation(magnitude, drill):
        return ""
    return "needs a rotation_model, or strata with a threshold_energy"


def _above_zero(unit: str, description: str, greatest: float) -> Quantity:
    return Quantity(unit, description, 0.0, greatest, exclusive=True)


def _above_one(description: str, greatest: float = 1e3) -> Quantity:
    return Quantity("", description, 1.0, greatest, exclusive=True)


def _rest(value: float, lost: float) -> float:
    return value * (1.0 - lost)


def _bound(damping_ratio: float, factor: float) -> float:
    """Return the damping ratio of a body that the same force moves 1/factor as far (assumed)."""
    return 1.0 - (1.0 - damping_ratio) / factor


def _true(value: bool, magnitude: float) -> bool:
    return True


def _slow(stage: Stage, time: int, messages: list[Fields]) -> list[Fields]:
    if not messages or time < stage.next:
        return []
    stage.next = time + round(stage.magnitude * SECOND)
    return messages[:1]


def _delayed(stage: Stage, time: int, messages: list[Fields]) -> list[Fields]:
    due = time + round(stage.magnitude * SECOND)
    stage.waiting.extend((due, fields) for fields in messages)
    late = []
    while stage.waiting and stage.waiting[0][0] <= time:
        late.append(stage.waiting.popleft()[1])
    return late


def _intermittent(stage: Stage, time: int, messages: list[Fields]) -> list[Fields]:
    return [fields for fields in messages if stage.random.random() >= stage.magnitude]


def _changed(change: Callable[[Stage, FieldPath, Any], Any], most: int | None = None) -> _Signal:
    """Return what changes copies of messages: all measured values, or the first ``most``."""

    def changed(stage: Stage, fields: Fields) -> Fields:
        stage.last = stage.last or fields
        copy, channel = _copy(fields), CHANNELS[stage.channel]
        for path in (*channel.numbers, *channel.flags)[:most]:
            _at(copy, path[:-1])[path[-1]] = change(stage, path, _at(fields, path))
        return copy

    return lambda stage, time, messages: [changed(stage, fields) for fields in messages]


def _at(fields: Any, path: FieldPath) -> Any:
    for name in path:
        fields = fields[name]
    return fields


def _copy(fields: Fields) -> Fields:
    return {
        name: _copy(value) if isinstance(value, dict) else value for name, value in fields.items()
    }


def _wrong(stage: Stage, path: FieldPath, value: Any) -> Any:
    return value if isinstance(value, bool) else stage.magnitude * value


def _garbage(stage: Stage, path: FieldPath, value: Any) -> Any:
    random = stage.random
    if isinstance(value, bool):
        return random.random() < 0.5
    if random.random() < NOT_FINITE_SHARE:
        return (math.nan, math.inf, -math.inf)[int(3.0 * random.random())]
    return float(np.uint64(random.bit_generator.random_raw()).view(np.float64))


def _noise(stage: Stage, path: FieldPath, value: float) -> float:
    """Return a value with normal noise, by Box and Muller's transform."""
    size = math.sqrt(-2.0 * logarithm_one_plus(-stage.random.random()))
    sine, _ = sin_cos_cycles(stage.random.random())
    return value + stage.magnitude * float(size * sine)


KINDS: dict[str, FaultKind] = {
    "free_mass_jammed": FaultKind(
        "the free mass is wedged to the drill tool and no longer strikes it",
        effects={"jammed": _true},
    ),
    "lost_preload": FaultKind(
        "the load spring pushes less than commanded",
        magnitude=_above_zero("", "share of the weight on bit that is lost", 1.0),
        default=0.5,
        effects={"preload_factor": _rest},
    ),
    "load_spring_binding": FaultKind(
        "the RPUD binds in its linear guide",
        magnitude=_above_one("factor on the rate of the load spring"),
        default=5.0,
        effects={"load_spring_rate": operator.mul, "rpud_damping_ratio": _bound},
    ),
    "drill_tool_binding": FaultKind(
        "the bit binds in its hole",
        needs=(_rock_while_drilling,),
        magnitude=_above_one("factor on the rate of the restoring spring, divisor of the progress"),
        default=5.0,
        effects={
            "restoring_spring_rate": operator.mul,
            "drill_tool_damping_ratio": _bound,
            "progress_factor": operator.truediv,
            "progress": operator.truediv,
        },
    ),
    "choking": FaultKind(
        "cuttings clog the hole",
        needs=(_rock,),
        magnitude=_above_zero(
            "", "share lost of the progress and of the drill tool's restitution", 1.0
        ),
        default=0.8,
        effects={
            "drill_tool_restitution": _rest,
            "progress_factor": _rest,
            "clearing": _rest,
            "clogged": lambda clogged, lost: 1.0 - (1.0 - lost),
        },
    ),
    "hard_rock": FaultKind(
        "the bit meets harder rock",
        needs=(_rock,),
        magnitude=_above_one("factor on the specific energy of the rock"),
        default=3.0,
        effects={"hardness": operator.mul},
    ),
    "resonance_drift": FaultKind(
        "the resonance of the actuator has moved",
        needs=(_resonance,),
        magnitude=Quantity("Hz", "offset of the resonance frequency", -1e4, 1e4),
        default=-200.0,
        unchanging=0.0,
        effects={"resonance_offset": operator.add},
    ),
    "restitution_loss": FaultKind(
        "the impacts are less elastic",
        magnitude=Quantity("", "factor on both coefficients of restitution", 0.0, 1.0, below=True),
        default=0.5,
        effects={"actuator_restitution": operator.mul, "drill_tool_restitution": operator.mul},
    ),
    "generator_lock_loss": FaultKind(
        "the generator stops tracking and runs at the commanded frequency",
        needs=(_tracking,),
        effects={"lock_lost": _true},
    ),
    "binding": FaultKind(
        "friction along the tool in its hole resists the rotation",
        needs=(_rotation, _hole),
        magnitude=_above_zero("N m", "torque of the friction", 100.0),
        default=0.05,
        effects={"extra_torque": operator.add},
    ),
    "hard_inclusion": FaultKind(
        "the bit meets a stone that is harder than its layer",
        needs=(_hole, _softer_rock),
        magnitude=_above_zero("Pa", "strength of the stone", 1e9),
        default=2e8,
        effects={"inclusion_strength": operator.add},
    ),
    "corkscrewing": FaultKind(
        "rock protrudes into the flutes, along which the tool screws itself in",
        needs=(_rotation, _hole),
        magnitude=_above_zero("N m", "torque of the protruding rock", 100.0),
        default=0.02,
        effects={"screw_torque": operator.add},
    ),
    "bit_walk": FaultKind(
        "the bit walks sideways until its hole guides it",
        needs=(_hole,),
        magnitude=_above_zero("m/s", "rate at which the bit walks", 0.1),
        default=5e-4,
        effects={"side_walk": operator.add},
    ),
    "feed_stall": FaultKind(
        "the drive of the feed stops", needs=(_arm,), effects={"feed_stalled": _true}
    ),
    "arm_slip": FaultKind(
        "the host of the arm slips away from the rock",
        needs=(_arm,),
        magnitude=_above_zero("m/s", "rate at which the host slips", 0.1),
        default=2e-4,
        effects={"arm_slip_rate": operator.add},
    ),
    "worn_bit": FaultKind(
        "the bit is worn",
        needs=(_hole, _wear),
        magnitude=_above_one("factor on the area of its wear flats", 1e4),
        default=3.0,
        effects={"worn_factor": operator.mul},
    ),
    "off": FaultKind("nothing is published", signal=lambda stage, time, messages: []),
    "stuck": FaultKind(
        "the values last published are repeated with new stamps",
        signal=_changed(lambda stage, path, value: _at(stage.last, path)),
    ),
    "garbage": FaultKind("random bit patterns instead of every value", signal=_changed(_garbage)),
    "wrong": FaultKind(
        "plausible values that are consistently wrong",
        magnitude=Quantity("", "factor on every measured number", -10.0, 10.0),
        default=0.5,
        unchanging=1.0,
        signal=_changed(_wrong),
    ),
    "slow": FaultKind(
        "messages go out at a lower rate",
        magnitude=_above_zero("s", "period in which at most one message goes out", 1e3),
        default=0.5,
        signal=_slow,
    ),
    "delayed": FaultKind(
        "every message comes late",
        magnitude=_above_zero("s", "time by which a message is late", 10.0),
        default=0.5,
        signal=_delayed,
    ),
    "intermittent": FaultKind(
        "messages are lost at random",
        magnitude=_above_zero("", "probability that a message is lost", 1.0),
        default=0.5,
        signal=_intermittent,
    ),
    "noise": FaultKind(
        "Gaussian noise on the main quantity",
        magnitude=_above_zero("", "standard deviation", 1e6),
        default=1.0,
        in_channel_unit=True,
        signal=_changed(_noise, 1),
    ),
    "bias": FaultKind(
        "a constant offset on the main quantity",
        magnitude=Quantity("", "offset", -1e6, 1e6),
        default=1.0,
        unchanging=0.0,
        in_channel_unit=True,
        signal=_changed(lambda stage, path, value: value + stage.magnitude, 1),
    ),
}
# What a channel of a model needs, whichever fault is on it.
CHANNEL_NEEDS: Mapping[str, _Need] = {"rotation": _rotation, "mount": _feed}


def fault_text(kind: str, channel: str = "") -> str:
    """Return what a fault is called, such as ``noise on wrench``."""
    return f"{kind} on {channel}" if channel else kind


def magnitude_text(kind: str, channel: str, magnitude: float) -> str:
    """Return the magnitude of a fault with its unit, such as ``5 N``; empty for none."""
    known = KINDS.get(kind)
    if not math.isfinite(magnitude) or (known and not known.magnitude):
        return ""
    has = known and (channel in CHANNELS or not known.in_channel_unit)
    allowed = known.quantity_on(channel) if known and has else None
    return quantity_in(allowed.unit if allowed else "", abs(magnitude)).text(magnitude)


def fault_forms(kinds: Collection[str], channels: Collection[str]) -> dict[str, dict[str, Any]]:
    """Return the forms of those kinds that are known, by kind."""
    return {kind: fault_form(kind, channels) for kind in kinds if kind in KINDS}


def fault_form(kind: str, channels: Collection[str]) -> dict[str, Any]:
    """Return what a form asks for to inject a fault, as plain values.

    ``sizes`` has unit and default of the magnitude by channel; the channel of the physics is "".
    """
    known = KINDS[kind]
    own = [] if known.physical else [*channels]
    allowed = {each: known.quantity_on(each) for each in own or [""]}
    return {
        "says": known.description,
        "channels": own,
        "meaning": known.magnitude.description if known.magnitude else "",
        "sizes": {each: [q.unit, known.default_on(each)] for each, q in allowed.items() if q},
    }
