"""Borehole: depth, cuttings and wear of the bit, by percussion and rotation."""

from __future__ import annotations

import dataclasses
import math

from rpud_sim.drilling.bit import NO_CUT, BitParameters, Cut, cut, radius_of
from rpud_sim.drilling.cuttings import Cuttings
from rpud_sim.drilling.inputs import Disturbances, Percussion
from rpud_sim.drilling.recent import RecentDrilling
from rpud_sim.drilling.rock import RockParameters
from rpud_sim.drilling.rotor_values import NO_RESISTANCE, NOT_TURNED, Resistance, Turned
from rpud_sim.drilling.strata import Layer, Strata, inclusion_in
from rpud_sim.model.elementary import arc_tangent, tangent


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

    Percussion deepens it as ``Progress`` does, by the energy of impacts above the threshold of the
    layer; rotation by the depth of its cut in each turn (``bit.cut``). Cuttings in the flutes hold
    both up (``cuttings``).
    """

    def __init__(self, bit: BitParameters, strata: Strata, rock: RockParameters) -> None:
        self._bit = bit
        self._strata = strata
        self._area = rock.hole_area
        self._radius = radius_of(rock.hole_area)
        self._breaking_share = rock.rock_energy_transfer
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
        self._owed = 0.0  # energy that the free mass took back from the drill tool [J]
        self._turned = NOT_TURNED  # in the last step
        self._energy = 0.0  # spent on drilling so far [J]
        self._cut_for: tuple[Layer, float, float, float] | None = None
        self._last_cut = NO_CUT
        self._known_state: BoreholeState | None = None

    @property
    def state(self) -> BoreholeState:
        """State at the last step."""
        if self._known_state is None:  # few steps are looked at
            self._known_state = self._state()
        return self._known_state

    @property
    def depth(self) -> float:
        """Depth of the hole [m]."""
        return self._depth

    @property
    def bottom(self) -> float:
        """Depth at which the bit meets rock [m]; infinite below the rock."""
        return math.inf if self._through else self._depth

    def resistance(
        self, weight_on_bit: float, in_rock: bool, disturbances: Disturbances
    ) -> Resistance:
        """Return the torque against the rotation of the drill tool."""
        if not (in_rock or self._tip > 0.0):
            return NO_RESISTANCE
        done = NO_CUT
        if in_rock and not self._through:
            done = self._cut(self._layer_under(disturbances), weight_on_bit, disturbances)
        flutes = self._cuttings.torque(self._tip, disturbances.clogged)
        faults = disturbances.extra_torque + disturbances.screw_torque
        return Resistance(done.cutting_torque, done.friction_torque, flutes, faults)

    def step(
        self,
        interval: float,
        percussion: Percussion,
        rotation: Turned,
        weight_on_bit: float,
        mount_position: float | None,
        disturbances: Disturbances,
    ) -> None:
        """Drill for one step.

        Args:
            mount_position: at the end of the step, as of ``MountState``; None without a feed.
        """
        turned = rotation.angle
        before, self._turned = self._turned, rotation
        resisted = rotation.resisted - before.resisted
        impact_energy = percussion.energy if percussion.in_rock else 0.0
        start = self._depth
        layer = self._strata.layers[self._layer]
        if percussion.in_rock and not self._through:
            usable, self._owed = impact_energy + self._owed, 0.0
            if usable < 0.0:
                usable, self._owed = 0.0, usable
            if disturbances.side_walk:
                self._walk(interval, turned, percussion, disturbances)
            self._deepen(usable, percussion.impacts, turned, weight_on_bit, disturbances)
            self._wear(rotation.friction - before.friction, layer)
        self._move_tip(mount_position)
        produced = (self._depth - start) * self._area
        impacts = percussion.impacts if percussion.in_rock else 0
        self._cuttings.step(interval, produced, turned, impacts, self._tip, disturbances.clearing)
        self._energy += weight_on_bit * (self._depth - start) + impact_energy + resisted
        self._recent.add(interval, self._depth, self._energy)
        self._worn_factor, self._clogged = disturbances.worn_factor, disturbances.clogged
        self._known_state = None

    def _cut(self, layer: Layer, weight_on_bit: float, disturbances: Disturbances) -> Cut:
        """Return the cut in a layer, with the pull of rock in the flutes."""
        weight = weight_on_bit
        if disturbances.screw_torque:
            weight += disturbances.screw_torque / (self._radius * self._screw_slope(layer))
        flat = self._wear_flat * disturbances.worn_factor
        if flat > self._area:
            flat = self._area
        given = (layer, weight, flat, disturbances.hardness)
        # Resistance and progress of a step need the same cut.
        if given != self._cut_for:
            self._cut_for = given
            self._last_cut = cut(
                self._bit, layer, self._radius, weight, flat, disturbances.hardness
            )
        return self._last_cut

    def _layer_under(self, disturbances: Disturbances) -> Layer:
        """Return the layer at the bottom, or the stone in it that is harder."""
        layer = self._strata.layers[self._layer]
        strength = disturbances.inclusion_strength
        return inclusion_in(layer, strength) if strength > layer.strength else layer

    def _screw_slope(self, layer: Layer) -> float:
        """Return torque over radius and axial force of a screw with friction: tan(phi + rho)."""
        slope = self._bit.flute_pitch / (2.0 * math.pi * self._radius)
        return tangent(min(arc_tangent(slope, 1.0) + arc_tangent(layer.friction, 1.0), 1.55))

    def _walk(
        self, interval: float, turned: float, percussion: Percussion, disturbances: Disturbances
    ) -> None:
        """Let the bit walk sideways until the hole is one radius deep and guides it."""
        if self._depth < self._radius and (turned > 0.0 or percussion.impacts):
            self._side_offset += disturbances.side_walk * interval

    def _deepen(
        self,
        energy: float,
        impacts: int,
        turned: float,
        weight_on_bit: float,
        disturbances: Disturbances,
    ) -> None:
        """Deepen the hole by one step, through as many layers as it reaches."""
        hardness = disturbances.hardness
        # A worn bit spreads the same blow over a larger area.
        flat, new = self._wear_flat * disturbances.worn_factor, self._bit.bit_wear_flat
        blunt = flat / new if flat > new > 0.0 else 1.0
        clearance = self._cuttings.clearance(self._tip, disturbances.clogged)
        held_up = disturbances.progress * clearance
        turns = turned / (2.0 * math.pi)
        left = 1.0  # of the step
        while left > 0.0:
            layer = self._layer_under(disturbances)
            breaking = energy - impacts * layer.threshold_energy * hardness * blunt
            deeper = self._breaking_share * breaking if breaking > 0.0 else 0.0
            deeper /= layer.specific_energy * hardness * self._area
            if turns > 0.0:
                deeper += self._cut(layer, weight_on_bit, disturbances).depth * turns
            deeper *= held_up
            end = self._strata.end_of(self._layer)
            if not self._depth + deeper * left >= end:
                self._depth += deeper * left
                return
            left -= (end - self._depth) / deeper
            self._depth = end
            if self._layer + 1 == len(self._strata.layers):
                self._through = True
                return
            self._layer += 1

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

    def _state(self) -> BoreholeState:
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
