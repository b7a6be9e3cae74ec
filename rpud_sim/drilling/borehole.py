"""Borehole: depth, cuttings and wear of the bit, by percussion and rotation."""

from __future__ import annotations

import dataclasses
import math

from rpud_sim.drilling.bit import NO_CUT, BitParameters, Cut, cut, radius_of
from rpud_sim.drilling.cuttings import Cuttings
from rpud_sim.drilling.inputs import Disturbances, Percussion
from rpud_sim.drilling.recent import RecentDrilling
from rpud_sim.drilling.rock import RockParameters
from rpud_sim.drilling.rotor_values import NO_RESISTANCE, Resistance, Turned
from rpud_sim.drilling.strata import Layer, Strata, inclusion_in

# Torque over radius and axial force of a screw, at most: a screw of 88.8 degrees.
STEEPEST = 48.0


@dataclasses.dataclass(frozen=True)
class BoreholeState:
    """State of the borehole at one time, immutable."""

    depth: float = 0.0  # of the hole [m]
    penetration_rate: float = 0.0  # mean over the last second [m/s]
    layer: str = ""  # name of the layer at the bottom; empty below the rock
    # energy for one unit of volume over the last second, after Teale [J/m^3]; NaN while the
    # hole does not get deeper
    specific_energy: float = math.nan
    packed_cuttings: float = 0.0  # volume of cuttings in the flutes [m^3]
    bit_wear: float = 0.0  # 0 for a new bit, 1 for a blunt one, more beyond
    side_offset: float = 0.0  # by which the bit has walked sideways at the start of the hole [m]


class Borehole:
    """Borehole in strata.

    Each impact deepens it by its energy above the threshold of the layer, and rotation by the depth
    of its cut in each turn (``bit.cut``). Cuttings in the flutes hold both up (``cuttings``). When
    it is as deep as the drill tool is long, the drill stands on the face of the rock, and nothing
    presses the bit to the bottom.

    Args:
        deepest: length of the drill tool [m].
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
        self._depth = 0.0
        self._tip = 0.0  # depth of the tool in the hole [m]
        self._layer = 0
        self._through = False
        self._wear_flat = bit.bit_wear_flat
        self._worn_factor = 1.0  # of a fault in the last step
        self._clogged = 0.0  # by a fault in the last step
        self._side_offset = 0.0
        self._energy = 0.0  # spent on drilling so far [J]

    @property
    def state(self) -> BoreholeState:
        """State at the last step."""
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
        """Depth of the hole [m]."""
        return self._depth

    @property
    def bottom(self) -> float:
        """Depth at which the bit meets rock [m]; infinite below the rock."""
        return math.inf if self._through else self._depth

    def resistance(self, percussion: Percussion, disturbances: Disturbances) -> Resistance:
        """Return the torque against the rotation of the drill tool."""
        if not (percussion.in_rock or self._tip > 0.0):
            return NO_RESISTANCE
        done = NO_CUT
        if self._drills(percussion):
            done = self._cut(self._layer_under(disturbances), percussion.rock_force, disturbances)
        flutes = self._cuttings.torque(self._tip, disturbances.clogged)
        faults = disturbances.extra_torque + disturbances.screw_torque
        return Resistance(done.cutting_torque, done.friction_torque, flutes, faults)

    def step(
        self,
        interval: float,
        percussion: Percussion,
        rotation: Turned,
        mount_position: float | None,
        disturbances: Disturbances,
    ) -> None:
        """Drill for one step.

        Args:
            mount_position: as of ``MountState``; None without a feed.
        """
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
                self._deepen(energy, angle, force, disturbances)
            self._move_tip(mount_position)
            produced = (self._depth - before) * self._area
            self._cuttings.step(produced, angle, impacts, self._tip, disturbances.clearing)
        self._wear(rotation.friction, layer)
        deeper = self._depth - start
        self._energy += force * deeper + math.fsum(energies) + rotation.resisted
        self._recent.add(interval, self._depth, self._energy)
        self._worn_factor, self._clogged = disturbances.worn_factor, disturbances.clogged

    def _drills(self, percussion: Percussion) -> bool:
        """Return whether the tool is in rock into which it can get deeper."""
        return percussion.in_rock and not self._through and self._depth < self._deepest

    def _cut(self, layer: Layer, force: float, disturbances: Disturbances) -> Cut:
        """Return the cut in a layer, with the pull of rock in the flutes."""
        if disturbances.screw_torque:
            force += disturbances.screw_torque / (self._radius * self._screw_slope(layer))
        flat = min(self._wear_flat * disturbances.worn_factor, self._area)
        return cut(self._bit, layer, self._radius, force, flat, disturbances.hardness)

    def _layer_under(self, disturbances: Disturbances) -> Layer:
        """Return the layer at the bottom, or the stone in it that is harder."""
        layer = self._strata.layers[self._layer]
        strength = disturbances.inclusion_strength
        return inclusion_in(layer, strength) if strength > layer.strength else layer

    def _screw_slope(self, layer: Layer) -> float:
        """Return torque over radius and axial force of a screw with friction: tan(phi + rho)."""
        slope = self._bit.flute_pitch / (2.0 * math.pi * self._radius)
        rest = 1.0 - slope * layer.friction
        total = slope + layer.friction
        return total / rest if total < STEEPEST * rest else STEEPEST

    def _deepen(
        self, energy: float, turned: float, force: float, disturbances: Disturbances
    ) -> None:
        """Deepen the hole by an impact or a rotation, through as many layers as it reaches."""
        hardness = disturbances.hardness
        # A worn bit spreads the same blow over a larger area.
        flat, new = self._wear_flat * disturbances.worn_factor, self._bit.bit_wear_flat
        blunt = flat / new if flat > new > 0.0 else 1.0
        clearance = self._cuttings.clearance(self._tip, disturbances.clogged)
        left = disturbances.progress * clearance  # of the depth without anything in the way
        while left > 0.0 and not self._through and self._depth < self._deepest:
            layer, deeper = self._layer_under(disturbances), 0.0
            breaking = energy - layer.threshold_energy * hardness * blunt
            if breaking > 0.0:
                deeper = self._breaking_share * breaking
                deeper /= layer.specific_energy * hardness * self._area
            if turned > 0.0:
                deeper += self._cut(layer, force, disturbances).depth * turned / (2.0 * math.pi)
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
        """Widen the wear flats, which together have the area of one circle.

        In the CERCHAR test the diameter of the flat grows with the distance slid under a constant
        force, so it grows here with the friction work, and the area with its square.
        """
        grown = self._bit.bit_wear_rate * layer.abrasiveness * friction_work
        if grown:
            most = max(self._area, self._bit.bit_wear_flat)
            radius = radius_of(self._wear_flat) + 0.5 * grown
            worn = math.pi * radius * radius
            self._wear_flat = min(worn, most)

    def _move_tip(self, mount_position: float | None) -> None:
        tip = self._depth
        if mount_position is not None:
            tip = mount_position if mount_position > 0.0 else 0.0
            if tip > self._depth:
                tip = self._depth
        if tip < self._tip:
            self._cuttings.withdraw(self._tip, tip)
        self._tip = tip
