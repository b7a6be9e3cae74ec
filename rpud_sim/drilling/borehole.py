"""Borehole: depth, cuttings and wear of the bit, by percussion and rotation."""

from __future__ import annotations

import dataclasses
import math
from array import array
from typing import NamedTuple

from rpud_sim.drilling.inputs import NO_PULSES, Disturbances, Percussion, Pulses
from rpud_sim.drilling.rock import Layer, RockParameters, Strata, inclusion_in
from rpud_sim.drilling.rotor import NO_RESISTANCE, Resistance, RotationStep
from rpud_sim.foundation.quantities import ParameterError, ParameterGroup, number
from rpud_sim.model.elementary import arc_tangent, exponential_minus_one


@dataclasses.dataclass(frozen=True)
class BitParameters(ParameterGroup):
    """Parameters of the bit and its flutes, in SI units.

    The paper names no bit: all values are assumed unless docs/explanation/drilling.md gives a
    source. The bit has the area of the hole, ``hole_area``.
    """

    bit_thrust_ratio: float = number(
        0.6, "", "thrust over torque force of a sharp cutting edge, zeta", 0.01, 10.0
    )
    bit_shape_factor: float = number(
        1.0, "", "spread of the wear flats over the radius of the bit, gamma", 0.5, 1.5
    )
    bit_wear_flat: float = number(1e-7, "m^2", "area of the wear flats of a new bit", 0.0, 1e-2)
    bit_blunt_flat: float = number(
        1e-6, "m^2", "area of the wear flats of a blunt bit, at which the wear is 1", 1e-12, 1e-2
    )
    bit_wear_rate: float = number(
        3e-7,
        "m/J",
        "growth of the wear flats' diameter by friction work in rock of abrasiveness 1",
        0.0,
        1.0,
    )
    bit_contact_depth: float = number(
        2e-5, "m", "depth of cut at which the wear flats bear on the rock as a whole", 1e-9, 1e-2
    )
    flute_area: float = number(
        8e-6, "m^2", "cross-sectional area of the flutes, which carry the cuttings", 1e-9, 1.0
    )
    flute_pitch: float = number(0.01, "m", "rise of the flutes in one turn", 1e-5, 1.0)
    flute_efficiency: float = number(
        0.3, "", "rise of the cuttings in one turn over the pitch, in a shallow hole", 0.0, 1.0
    )
    flute_transport_depth: float = number(
        0.1, "m", "depth at which friction on the wall halves the rise of the cuttings", 1e-4, 1e3
    )
    flute_torque: float = number(
        0.05, "N m/m", "torque of full flutes for each metre in the hole", 0.0, 1e4
    )
    cuttings_bulking: float = number(
        1.8, "", "volume of the cuttings over the volume of their rock", 1.0, 5.0
    )
    cuttings_lift: float = number(
        2e-6, "m", "rise of the cuttings by one impact, in a shallow hole", 0.0, 1e-2
    )
    cuttings_choke: float = number(
        0.5, "", "filling of the flutes above which progress slows", 0.0, 0.95
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.bit_blunt_flat > self.bit_wear_flat:
            raise ParameterError(
                f"bit_blunt_flat = {self.bit_blunt_flat:g} m^2 is not above "
                f"bit_wear_flat = {self.bit_wear_flat:g} m^2"
            )


class Cut(NamedTuple):
    """Cut and torques of a bit on the bottom of its hole, immutable."""

    depth: float = 0.0  # depth of the cut in one turn, if the tool turns [m]
    cutting_torque: float = 0.0  # torque that cuts the rock [N m]
    friction_torque: float = 0.0  # torque of the wear flats on the rock [N m]


NO_CUT = Cut()


def excess(pulses: Pulses, force: float) -> float:
    """Return the impulse of one of the pulses above a force [N s]."""
    peak = 0.5 * math.pi * pulses.impulse / pulses.duration
    if not peak > force:
        return 0.0
    rest = math.sqrt((peak - force) * (peak + force))
    angle = arc_tangent(rest, force)  # angle from the crest to where the pulse has this force
    return 2.0 * pulses.duration / math.pi * (rest - force * angle)


def cut(
    bit: BitParameters,
    layer: Layer,
    radius: float,
    mean_force: float,
    wear_flat: float,
    hardness: float = 1.0,
    pulses: Pulses = NO_PULSES,
) -> Cut:
    """Return how a bit cuts under a mean force [N], after Detournay and Defourny (1992).

    With specific energy eps, strength sigma, radius a, depth of cut d, wear flat A_f, d_c the
    contact depth:

        W = zeta eps a d + F_f          T = eps a^2 d / 2 + mu gamma a F_f / 2
        F_f = sigma A_f min(d / d_c, 1)

    The law holds at each instant, and the result is its mean: what the pulses leave of the force
    acts always. ``hardness`` is a factor on eps and sigma.
    """
    if not mean_force > 0.0:
        return NO_CUT
    edge = bit.bit_thrust_ratio * layer.specific_energy * hardness * radius  # N for 1 m of cut
    bearing = layer.strength * hardness * wear_flat
    both = edge + bearing / bit.bit_contact_depth
    # Above this force all further force cuts.
    bears = both * bit.bit_contact_depth
    more = 1.0 / edge - 1.0 / both
    struck = pulses.rate * pulses.impulse
    share = 1.0 if struck <= mean_force else mean_force / struck
    steady = mean_force - share * struck
    depth = mean_force / both
    if steady > bears:
        depth += more * (steady - bears)
    if share * struck > 0.0:
        depth += more * share * pulses.rate * excess(pulses, bears)
    cutting_force = edge * depth
    if cutting_force > mean_force:
        cutting_force = mean_force
    friction_force = mean_force - cutting_force
    return Cut(
        depth,
        0.5 * layer.specific_energy * hardness * radius * radius * depth,
        0.5 * layer.friction * bit.bit_shape_factor * radius * friction_force,
    )


def radius_of(area: float) -> float:
    return math.sqrt(area / math.pi)


class Cuttings:
    """Volume V of cuttings in the flutes of the tool, which hold their area times the depth.

    They come in at the bottom at a rate q and rise at a speed v, by rotation and impacts:
    dV/dt = q - V v / depth. A tool that is drawn back takes with it what is outside the hole.
    """

    def __init__(self, bit: BitParameters) -> None:
        self._bit = bit
        self.volume = 0.0  # volume of cuttings in the hole [m^3]

    def filling(self, depth: float, clogged: float = 0.0) -> float:
        """Share of the flutes that is full, 0 to 1; a fault may clog some of the rest."""
        if depth <= 0.0:
            return 0.0
        full = self.volume / (self._bit.flute_area * depth)
        full = full if full < 1.0 else 1.0
        return full + clogged * (1.0 - full)

    def clearance(self, depth: float, clogged: float = 0.0) -> float:
        """Factor on the progress: 1 up to the choke, falling to 0 with full flutes."""
        choke = self._bit.cuttings_choke
        free = (1.0 - self.filling(depth, clogged)) / (1.0 - choke)
        return free if free < 1.0 else 1.0

    def torque(self, depth: float, clogged: float = 0.0) -> float:
        """Torque that resists the rotation [N m], in proportion to depth and filling."""
        return self._bit.flute_torque * depth * self.filling(depth, clogged)

    def step(
        self, produced: float, turned: float, impacts: float, depth: float, clearing: float
    ) -> None:
        """Let cuttings of a volume of rock [m^3] come in, and leave by impacts or a part of a turn.

        ``clearing`` is a factor on the speed at which they rise, 0 to 1.
        """
        bit = self._bit
        if depth <= 0.0:
            self.volume = 0.0
            return
        turns = turned / (2.0 * math.pi)
        risen = bit.flute_efficiency * bit.flute_pitch * turns + bit.cuttings_lift * impacts
        risen *= clearing / (1.0 + depth / bit.flute_transport_depth)
        came = bit.cuttings_bulking * produced
        share = risen / depth  # V v / depth over the step, in units of V
        if share > 0.0:
            left = -exponential_minus_one(-share)
            self.volume += (came / share - self.volume) * left
        else:
            self.volume += came
        # The flutes hold no more; what is beyond is pressed into the wall.
        self.volume = min(self.volume, bit.flute_area * depth)

    def withdraw(self, before: float, after: float) -> None:
        self.volume *= after / before if before > 0.0 else 0.0


# The means go over this time [s].
WINDOW = 1.0


class RecentDrilling:
    """Depth and energy after each of the last steps, from which means over a second follow."""

    def __init__(self) -> None:
        # Rings of time [s], depth [m] and energy [J]; arrays, so that copies are cheap.
        self._times, self._depths, self._energies = (array("d", bytes(8)) for _ in range(3))
        self._now = 0

    def add(self, interval: float, depth: float, energy: float) -> None:
        """Add a step; depth of the hole [m] and energy spent [J] are at its end."""
        values = (self._times[self._now] + interval, depth, energy)
        rings = (self._times, self._depths, self._energies)
        steps = len(self._times)
        grows = (steps - 0.5) * interval < WINDOW
        self._now = self._now + 1 if grows else (self._now + 1) % steps
        for ring, value in zip(rings, values, strict=True):
            if grows:
                ring.append(value)
            else:
                ring[self._now] = value

    def _change_of(self, ring: array[float]) -> float:
        return ring[self._now] - ring[(self._now + 1) % len(ring)]

    @property
    def penetration_rate(self) -> float:
        time = self._change_of(self._times)
        return self._change_of(self._depths) / time if time > 0.0 else 0.0

    def specific_energy(self, area: float) -> float:
        """Return energy over volume [J/m^3], after Teale (1965); NaN without either of them."""
        deeper, energy = self._change_of(self._depths), self._change_of(self._energies)
        return energy / (area * deeper) if deeper > 0.0 and energy > 0.0 else math.nan


# Torque over radius and axial force of a screw, at most: a screw of 88.8 degrees.
STEEPEST = 48.0


@dataclasses.dataclass(frozen=True)
class BoreholeState:
    """State of the borehole at one time, immutable."""

    depth: float = 0.0  # depth of the hole [m]
    penetration_rate: float = 0.0  # mean over the last second [m/s]
    layer: str = ""  # name of the layer at the bottom; empty below the rock
    # energy for one unit of volume over the last second, after Teale [J/m^3]; NaN while the
    # hole does not get deeper
    specific_energy: float = math.nan
    packed_cuttings: float = 0.0  # volume of cuttings in the flutes [m^3]
    bit_wear: float = 0.0  # 0 for a new bit, 1 for a blunt one, more beyond
    side_offset: float = 0.0  # how far the bit walked sideways at the start of the hole [m]


class Borehole:
    """Borehole in strata, at most as deep as the drill tool is long [m].

    Each impact deepens it by its energy above the threshold of the layer, and rotation by the depth
    of its ``cut`` in each turn; cuttings in the flutes hold both up.
    """

    def __init__(
        self, bit: BitParameters, strata: Strata, rock: RockParameters, deepest: float
    ) -> None:
        self._bit = bit
        self._strata = strata
        self._area = rock.hole_area
        self._radius = radius_of(rock.hole_area)
        self._breaking_share = rock.rock_energy_transfer
        self._deepest = deepest
        self._cuttings = Cuttings(bit)
        self._recent = RecentDrilling()
        self._depth = self._tip = 0.0  # depth of the hole, and of the tool in it [m]
        self._layer = 0
        self._through = False
        self._wear_flat = bit.bit_wear_flat
        self._worn_factor, self._clogged = 1.0, 0.0  # effects of faults in the last step
        self._side_offset = 0.0
        self._energy = 0.0  # spent on drilling so far [J]

    @property
    def state(self) -> BoreholeState:
        new, blunt = self._bit.bit_wear_flat, self._bit.bit_blunt_flat
        worn = min(self._wear_flat * self._worn_factor, max(self._area, new))
        filling = self._cuttings.filling(self._tip, self._clogged)
        return BoreholeState(
            depth=self._depth,
            penetration_rate=self._recent.penetration_rate,
            layer="" if self._through else self._strata.layers[self._layer].name,
            specific_energy=self._recent.specific_energy(self._area),
            packed_cuttings=filling * self._bit.flute_area * self._tip,
            bit_wear=(worn - new) / (blunt - new),
            side_offset=self._side_offset,
        )

    @property
    def depth(self) -> float:
        return self._depth

    @property
    def bottom(self) -> float:
        """Depth at which the bit meets rock [m]; infinite below the rock."""
        return math.inf if self._through else self._depth

    def resistance(self, percussion: Percussion, disturbances: Disturbances) -> Resistance:
        if not (percussion.in_rock or self._tip > 0.0):
            return NO_RESISTANCE
        done = NO_CUT
        if self._drills(percussion):
            layer = self._layer_under(disturbances)
            done = self._cut(layer, percussion.rock_force, percussion.pulses, disturbances)
        flutes = self._cuttings.torque(self._tip, disturbances.clogged)
        faults = disturbances.extra_torque + disturbances.screw_torque
        return Resistance(done.cutting_torque, done.friction_torque, flutes, faults)

    def step(
        self,
        interval: float,
        percussion: Percussion,
        rotation: RotationStep,
        mount_position: float | None,
        disturbances: Disturbances,
    ) -> None:
        """Drill for one step; ``mount_position`` is from ``MountState``, None without a feed."""
        start = self._depth
        layer = self._strata.layers[self._layer]
        drills = self._drills(percussion)
        energies = percussion.energies if percussion.in_rock else ()
        turned, force = rotation.angle, percussion.rock_force if drills else 0.0
        # The bit walks until the hole is one radius deep and guides it.
        if drills and start < self._radius and (turned > 0.0 or energies):
            self._side_offset += disturbances.side_walk * interval
        # One impact after the other, however many a step has, and then the rotation.
        parts = [(energy, 1, 0.0) for energy in energies]
        for energy, impacts, angle in (*parts, (0.0, 0, turned)):
            before = self._depth
            if drills:
                self._deepen(energy, angle, force, percussion.pulses, disturbances)
            self._move_tip(mount_position)
            produced = (self._depth - before) * self._area
            self._cuttings.step(produced, angle, impacts, self._tip, disturbances.clearing)
        self._wear(rotation.friction, layer)
        deeper = self._depth - start
        # A squeezed mass gives energy back: that is none that tool and rock absorb.
        absorbed = math.fsum(energy for energy in energies if energy > 0.0)
        self._energy += force * deeper + absorbed + rotation.resisted
        self._recent.add(interval, self._depth, self._energy)
        self._worn_factor, self._clogged = disturbances.worn_factor, disturbances.clogged

    def _drills(self, percussion: Percussion) -> bool:
        """Whether the tool is in rock into which it can get deeper."""
        return percussion.in_rock and not self._through and self._depth < self._deepest

    def _cut(self, layer: Layer, force: float, pulses: Pulses, disturbances: Disturbances) -> Cut:
        """Return the cut in a layer, with the pull of rock in the flutes."""
        if disturbances.screw_torque:
            force += disturbances.screw_torque / (self._radius * self._screw_slope(layer))
        flat = min(self._wear_flat * disturbances.worn_factor, self._area)
        return cut(self._bit, layer, self._radius, force, flat, disturbances.hardness, pulses)

    def _layer_under(self, disturbances: Disturbances) -> Layer:
        """Return the layer at the bottom, or a harder stone in it."""
        layer = self._strata.layers[self._layer]
        strength = disturbances.inclusion_strength
        return inclusion_in(layer, strength) if strength > layer.strength else layer

    def _screw_slope(self, layer: Layer) -> float:
        """Torque over radius and axial force of a screw with friction: tan(phi + rho)."""
        slope = self._bit.flute_pitch / (2.0 * math.pi * self._radius)
        rest = 1.0 - slope * layer.friction
        total = slope + layer.friction
        return total / rest if total < STEEPEST * rest else STEEPEST

    def _deepen(
        self,
        energy: float,
        turned: float,
        force: float,
        pulses: Pulses,
        disturbances: Disturbances,
    ) -> None:
        """Deepen the hole by an impact or a rotation, through as many layers as it reaches."""
        hardness = disturbances.hardness
        # A worn bit spreads the same blow over a larger area.
        flat, new = self._wear_flat * disturbances.worn_factor, self._bit.bit_wear_flat
        blunt = flat / new if flat > new > 0.0 else 1.0
        clearance = self._cuttings.clearance(self._tip, disturbances.clogged)
        left = disturbances.progress * clearance  # share of the depth without anything in the way
        while left > 0.0 and not self._through and self._depth < self._deepest:
            layer, deeper = self._layer_under(disturbances), 0.0
            breaking = energy - layer.threshold_energy * hardness * blunt
            if breaking > 0.0:
                deeper = self._breaking_share * breaking
                deeper /= layer.specific_energy * hardness * self._area
            if turned > 0.0:
                deeper += (
                    self._cut(layer, force, pulses, disturbances).depth * turned / (2.0 * math.pi)
                )
            layer_end = self._strata.end_of(self._layer)
            end = min(layer_end, self._deepest)
            if not self._depth + deeper * left >= end:
                self._depth += deeper * left
                return
            left -= (end - self._depth) / deeper
            self._depth = end
            if end == layer_end:
                self._through = self._layer + 1 == len(self._strata.layers)
                self._layer += not self._through

    def _wear(self, friction_work: float, layer: Layer) -> None:
        """Widen the wear flats: their diameter grows with the friction work, as for CERCHAR."""
        grown = self._bit.bit_wear_rate * layer.abrasiveness * friction_work
        if grown:
            most = max(self._area, self._bit.bit_wear_flat)
            radius = radius_of(self._wear_flat) + 0.5 * grown
            self._wear_flat = min(math.pi * radius * radius, most)

    def _move_tip(self, mount_position: float | None) -> None:
        tip = self._depth
        if mount_position is not None:
            tip = min(max(mount_position, 0.0), self._depth)
        if tip < self._tip:
            self._cuttings.withdraw(self._tip, tip)
        self._tip = tip
