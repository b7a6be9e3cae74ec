"""Kinds of faults of the drill and of its signals: what each is and needs.

A physical fault changes the drill (``faults.effects_of``), so that every channel shows its effect
through the physics. A signal fault changes the messages of one channel of a healthy drill
(``signals.Stage``). ``docs/reference/faults.md`` explains the kinds and says where the effect of a
magnitude is assumed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

from rpud_sim.foundation.quantities import Quantity
from rpud_sim.model.parameters import QUANTITIES
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.topics import CHANNELS

# Why a fault would have no effect, or no meaning, on a drill; empty if it has.
_Need = Callable[[float, Configuration], str]


@dataclasses.dataclass(frozen=True)
class FaultKind:
    """Kind of fault."""

    description: str  # one phrase
    needs: tuple[_Need, ...] = ()  # of the drill
    # meaning of its magnitude, None if it has none; without unit if the unit is the channel's
    magnitude: Quantity | None = None
    # magnitude that NaN stands for; a factor on the channel's scale if the unit is the
    # channel's
    default: float = 0.0
    # magnitude inside the range that would change nothing and is rejected
    unchanging: float | None = None
    # whether the magnitude has the unit of the channel's main quantity
    in_channel_unit: bool = False
    # whether it changes the drill; otherwise it changes the messages of a channel
    physical: bool = True

    def quantity_on(self, channel: str) -> Quantity | None:
        """Return the meaning of the magnitude on a channel; None if the kind has none."""
        if self.magnitude is None or not self.in_channel_unit:
            return self.magnitude
        return dataclasses.replace(self.magnitude, unit=CHANNELS[channel].unit)

    @property
    def takes_zero(self) -> bool:
        """Whether zero is a magnitude with an effect, not only a way to leave it open."""
        if self.magnitude is None or self.unchanging == 0.0:
            return False
        return not self.magnitude.exclusive and self.magnitude.minimum <= 0.0

    def default_on(self, channel: str) -> float:
        """Return the magnitude that NaN stands for on a channel."""
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


def _rock(magnitude: float, drill: Configuration) -> str:
    if drill.rock.rock_model != "none" or drill.drilling.layers is not None:
        return ""
    return "needs a rock_model, which is none, or strata"


def _rock_while_drilling(magnitude: float, drill: Configuration) -> str:
    reason = _rock(magnitude, drill) if drill.parameters.regime == "drilling" else ""
    return f"acts on the progress while drilling and {reason}" if reason else ""


def _rotation(magnitude: float, drill: Configuration) -> str:
    there = drill.rotation.rotation_model != "none"
    return "" if there else "needs a rotation_model, which is none"


def _feed(magnitude: float, drill: Configuration) -> str:
    return "" if drill.has_feed else "needs a feed_model, which is none"


def _hole(magnitude: float, drill: Configuration) -> str:
    there = drill.drilling.layers is not None
    return "" if there else "needs strata, or a rotation_model with a rock_model"


def _softer_rock(magnitude: float, drill: Configuration) -> str:
    layers = drill.drilling.layers
    softest = min(layer.strength for layer in layers.layers) if layers else 0.0
    if magnitude > softest:
        return ""
    return f"is not harder than any layer: the softest has a strength of {softest:g} Pa"


def _wear(magnitude: float, drill: Configuration) -> str:
    layers = drill.drilling.layers
    blows_fail = layers is not None and any(each.threshold_energy for each in layers.layers)
    if blows_fail or not _rotation(magnitude, drill):
        return ""
    return "needs a rotation_model, or strata with a threshold_energy"


def _above_zero(unit: str, description: str, greatest: float) -> Quantity:
    return Quantity(unit, description, 0.0, greatest, exclusive=True)


def _above_one(description: str, greatest: float = 1e3) -> Quantity:
    return Quantity("", description, 1.0, greatest, exclusive=True)


KINDS: Mapping[str, FaultKind] = {
    "free_mass_jammed": FaultKind(
        "the free mass is wedged to the drill tool and strikes it no more"
    ),
    "lost_preload": FaultKind(
        "the load spring pushes less than commanded",
        magnitude=_above_zero("", "share of the weight on bit that is lost", 1.0),
        default=0.5,
    ),
    "load_spring_binding": FaultKind(
        "the RPUD binds in its linear guide",
        magnitude=_above_one("factor on the rate of the load spring"),
        default=5.0,
    ),
    "drill_tool_binding": FaultKind(
        "the bit binds in its hole",
        needs=(_rock_while_drilling,),
        magnitude=_above_one("factor on the rate of the restoring spring, divisor of the progress"),
        default=5.0,
    ),
    "choking": FaultKind(
        "cuttings clog the hole",
        needs=(_rock,),
        magnitude=_above_zero(
            "", "share lost of the progress and of the drill tool's restitution", 1.0
        ),
        default=0.8,
    ),
    "hard_rock": FaultKind(
        "the bit meets harder rock",
        needs=(_rock,),
        magnitude=_above_one("factor on the specific energy of the rock"),
        default=3.0,
    ),
    "resonance_drift": FaultKind(
        "the resonance of the actuator has moved",
        needs=(_resonance,),
        magnitude=Quantity("Hz", "offset of the resonance frequency", -1e4, 1e4),
        default=-200.0,
        unchanging=0.0,
    ),
    "restitution_loss": FaultKind(
        "the impacts are less elastic",
        magnitude=Quantity("", "factor on both coefficients of restitution", 0.0, 1.0, below=True),
        default=0.5,
    ),
    "generator_lock_loss": FaultKind(
        "the generator tracks no more and runs at the commanded frequency",
        needs=(_tracking,),
    ),
    "binding": FaultKind(
        "friction along the tool in its hole resists the rotation",
        needs=(_rotation, _hole),
        magnitude=_above_zero("N m", "torque of the friction", 100.0),
        default=0.05,
    ),
    "hard_inclusion": FaultKind(
        "the bit meets a stone that is harder than its layer",
        needs=(_hole, _softer_rock),
        magnitude=_above_zero("Pa", "strength of the stone", 1e9),
        default=2e8,
    ),
    "corkscrewing": FaultKind(
        "rock protrudes into the flutes, along which the tool screws itself in",
        needs=(_rotation, _hole),
        magnitude=_above_zero("N m", "torque of the rock that protrudes", 100.0),
        default=0.02,
    ),
    "bit_walk": FaultKind(
        "the bit walks sideways until its hole guides it",
        needs=(_hole,),
        magnitude=_above_zero("m/s", "rate at which the bit walks", 0.1),
        default=5e-4,
    ),
    "feed_stall": FaultKind("the drive of the feed stands still", needs=(_feed,)),
    "arm_slip": FaultKind(
        "the host of the arm slips away from the rock",
        needs=(_feed,),
        magnitude=_above_zero("m/s", "rate at which the host slips", 0.1),
        default=2e-4,
    ),
    "worn_bit": FaultKind(
        "the bit is worn",
        needs=(_hole, _wear),
        magnitude=_above_one("factor on the area of its wear flats", 1e4),
        default=3.0,
    ),
    "off": FaultKind("nothing is published", physical=False),
    "stuck": FaultKind("the values last published are repeated with new stamps", physical=False),
    "garbage": FaultKind("random bit patterns in place of every value", physical=False),
    "wrong": FaultKind(
        "plausible values that are consistently wrong",
        physical=False,
        magnitude=Quantity("", "factor on every measured number", -10.0, 10.0),
        default=0.5,
        unchanging=1.0,
    ),
    "slow": FaultKind(
        "messages go out at a lower rate",
        physical=False,
        magnitude=_above_zero("s", "period in which at most one message goes out", 1e3),
        default=0.5,
    ),
    "delayed": FaultKind(
        "every message comes late",
        physical=False,
        magnitude=_above_zero("s", "time by which a message is late", 10.0),
        default=0.5,
    ),
    "intermittent": FaultKind(
        "messages are lost at random",
        physical=False,
        magnitude=_above_zero("", "probability that a message is lost", 1.0),
        default=0.5,
    ),
    "noise": FaultKind(
        "Gaussian noise on the main quantity",
        physical=False,
        magnitude=_above_zero("", "standard deviation", 1e6),
        default=1.0,
        in_channel_unit=True,
    ),
    "bias": FaultKind(
        "a constant offset on the main quantity",
        physical=False,
        magnitude=Quantity("", "offset", -1e6, 1e6),
        default=1.0,
        unchanging=0.0,
        in_channel_unit=True,
    ),
}
# What a channel of a model needs, whichever fault is on it.
CHANNEL_NEEDS: Mapping[str, _Need] = {"rotation": _rotation, "mount": _feed}
