"""The borehole deepens by percussion and rotation, layer by layer, and wears the bit."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.drilling.borehole import BitParameters, Borehole, cut, radius_of
from rpud_sim.drilling.inputs import UNDISTURBED, Disturbances, Percussion
from rpud_sim.drilling.rock import (
    Layer,
    Progress,
    RockParameters,
    Strata,
    find_strata,
    uniform_strata,
)
from rpud_sim.drilling.rotor import NOT_TURNED, RotationParameters, Rotor
from rpud_sim.foundation.parameters import quantities
from rpud_sim.model.segment import IMPACT

ROCK = RockParameters()
STEP = 1e-3  # s
LENGTH = 0.09  # of the drill tool [m]
# Flutes so wide that cuttings never matter, and a bit without wear flats.
CLEAR = BitParameters(flute_area=1.0, bit_wear_flat=0.0)
DRIVE = RotationParameters(rotation_model="friction_drive")


class Drill:
    """Rotor and borehole, stepped as the process does."""

    def __init__(self, strata="sandstone", bit=CLEAR, rotates=True, rock=ROCK, length=LENGTH):
        layers = find_strata(strata) if isinstance(strata, str) else strata
        self.borehole = Borehole(bit, layers, rock, length)
        self.rotor = Rotor(DRIVE) if rotates else None
        self.steps = 0

    def run(self, seconds, force=10.0, energy=0.0, mount=None, faults=UNDISTURBED, ratio=1.0):
        """Drill with one impact in each 4 ms, of an energy [J]."""
        in_rock = mount is None or mount >= self.borehole.bottom
        for _ in range(round(seconds / STEP)):
            self.steps += 1
            impacts = int(energy > 0.0 and self.steps % 4 == 0)
            force = force if in_rock else 0.0
            percussion = Percussion((energy,) * impacts, ratio, in_rock, 0.0, force)
            turned = NOT_TURNED
            if self.rotor:
                resistance = self.borehole.resistance(percussion, faults)
                turned = self.rotor.step(STEP, ratio, resistance)
            self.borehole.step(STEP, percussion, turned, mount, faults)
        return self.borehole.state


def blow(*energies, force=0.0):
    """Percussion of a step in which impacts of some energies [J] end."""
    return Percussion(energies, 1.0, True, 0.0, force)


def filling(state):
    """Share of the default flutes that is full, with the tool at the bottom of the hole."""
    room = BitParameters().flute_area * state.depth
    return state.packed_cuttings / room if room else 0.0


def test_by_percussion_alone_it_is_as_deep_as_by_the_rock_parameters():
    energies = np.random.default_rng(1).normal(0.1, 0.1, 200)  # some are taken back
    impacts = np.zeros(200, IMPACT)
    impacts["energy_transferred"] = energies
    progress = Progress(dataclasses.replace(ROCK, rock_model="specific_energy"), LENGTH)
    progress.add(impacts)
    borehole = Borehole(CLEAR, uniform_strata(ROCK.rock_specific_energy), ROCK, LENGTH)
    for energy in energies:
        borehole.step(STEP, blow(energy), NOT_TURNED, None, UNDISTURBED)
    assert borehole.state.depth == pytest.approx(progress.depth, rel=1e-12)


def test_impacts_below_the_threshold_break_nothing():
    threshold = find_strata("sandstone").layers[0].threshold_energy
    assert Drill(rotates=False).run(0.1, energy=0.99 * threshold).depth == 0.0
    deep = Drill(rotates=False).run(0.4, energy=3.0 * threshold).depth
    deeper = Drill(rotates=False).run(0.4, energy=5.0 * threshold).depth
    assert deeper == pytest.approx(2.0 * deep)


@given(st.lists(st.floats(-0.01, 0.1), min_size=1, max_size=8), st.floats(0.0, 0.08))
def test_the_threshold_acts_on_each_impact_however_steps_divide_them(energies, threshold):
    layer = dataclasses.replace(find_strata("sandstone").layers[0], threshold_energy=threshold)
    breaking = math.fsum(max(0.0, energy - threshold) for energy in energies)
    depth = ROCK.rock_energy_transfer * breaking / (layer.specific_energy * ROCK.hole_area)
    found = []
    for steps in ([energies], [[energy] for energy in energies]):
        borehole = Borehole(CLEAR, Strata((layer,)), ROCK, LENGTH)
        for each in steps:
            borehole.step(STEP, blow(*each), NOT_TURNED, None, UNDISTURBED)
        found.append(borehole.depth)
    assert found[0] == found[1] == pytest.approx(depth, rel=1e-12)


def test_impacts_that_choke_hold_each_other_up_however_steps_divide_them():
    depths = []
    for count in (1, 6):  # impacts in a step
        borehole = Borehole(BitParameters(), find_strata("chalk"), ROCK, LENGTH)
        for _ in range(300 // count):
            borehole.step(STEP, blow(*[0.5] * count), NOT_TURNED, None, UNDISTURBED)
        depths.append(borehole.depth)
    free = 300 * 0.498 * ROCK.rock_energy_transfer / (10e6 * ROCK.hole_area)
    assert depths[0] == depths[1] < 0.9 * free


def test_the_hole_is_at_most_as_deep_as_the_tool_is_long_and_nothing_resists_there():
    drill = Drill(rock=dataclasses.replace(ROCK, rock_energy_transfer=1.0), length=2e-3)
    drill.run(0.05, energy=1.0)
    assert drill.rotor.state.torque > 0.0
    wear = [drill.run(seconds, energy=1.0).bit_wear for seconds in (1.0, 1.0)]
    state = drill.borehole.state
    assert (state.depth, drill.borehole.bottom, state.layer) == (2e-3, 2e-3, "sandstone")
    assert state.penetration_rate == 0.0
    assert math.isnan(state.specific_energy)
    assert wear[0] == wear[1]
    assert drill.rotor.state.torque < 1e-9  # of the last cuttings in the flutes


def test_by_rotation_the_rate_is_the_depth_of_cut_times_the_turns():
    drill = Drill()
    drill.run(0.1)
    state = drill.run(1.0)
    done = cut(CLEAR, find_strata("sandstone").layers[0], radius_of(ROCK.hole_area), 10.0, 0.0)
    turns = drill.rotor.state.rate / (2.0 * math.pi)
    assert state.penetration_rate == pytest.approx(done.depth * turns, rel=1e-6)
    assert drill.rotor.state.torque == pytest.approx(done.cutting_torque, rel=1e-8)


def test_a_sharp_bit_recovers_the_least_specific_energy_of_teale():
    # e = F / A + 2 pi N T / (A u): the thrust adds zeta d / (pi a), which is small for fine cuts.
    sharp = dataclasses.replace(CLEAR, bit_thrust_ratio=0.01)
    state = Drill(bit=sharp).run(1.5, force=0.2)
    assert state.specific_energy == pytest.approx(75e6, rel=2e-4)


def test_deeper_cuts_of_a_blunt_bit_come_close_to_the_least_specific_energy():
    layer = dataclasses.replace(find_strata("sandstone").layers[0], abrasiveness=0.0)
    blunt = dataclasses.replace(CLEAR, bit_wear_flat=2e-8)
    least = layer.specific_energy
    found = []
    for weight in (4.0, 8.0, 16.0, 30.0):
        state = Drill(Strata((layer,)), blunt).run(1.5, force=weight)
        thrust = weight / ROCK.hole_area
        found.append((state.specific_energy - thrust) / least)
    # The wear flat's friction becomes small beside the cut; nothing falls below the rock's energy.
    assert found == sorted(found, reverse=True)
    assert found[0] > 1.1
    assert 1.0 < found[-1] < 1.02


def test_percussion_whose_energy_all_breaks_rock_takes_the_least_specific_energy():
    whole = dataclasses.replace(ROCK, rock_energy_transfer=1.0)
    rock = uniform_strata(75e6)
    state = Drill(rock, rotates=False, rock=whole).run(1.2, force=0.0, energy=0.1)
    assert state.specific_energy == pytest.approx(75e6, rel=1e-9)


THREE = Strata(
    (Layer("soft", 0.0, 1e6, 1e6), Layer("middle", 1e-3, 1e7, 1e7), Layer("hard", 2e-3, 1e8, 1e8)),
    bottom=2.5e-3,
)


def test_layers_are_crossed_at_their_depths_also_within_one_step():
    whole = dataclasses.replace(ROCK, rock_energy_transfer=1.0)
    # Energies of the layers: 20 mJ, 200 mJ, 1000 mJ.
    for energy, depth, name in (
        (0.01, 0.5e-3, "soft"),
        (0.02, 1e-3, "middle"),
        (0.12, 1.5e-3, "middle"),
        (0.22, 2e-3, "hard"),
        (0.72, 2.25e-3, "hard"),
    ):
        at_once = Borehole(CLEAR, THREE, whole, LENGTH)
        at_once.step(STEP, blow(energy), NOT_TURNED, None, UNDISTURBED)
        state = at_once.state
        assert (state.depth, state.layer) == (pytest.approx(depth, rel=1e-12), name)
        slowly = Borehole(CLEAR, THREE, whole, LENGTH)
        for _ in range(7):
            slowly.step(STEP, blow(energy / 7), NOT_TURNED, None, UNDISTURBED)
        assert slowly.state.depth == pytest.approx(depth, rel=1e-12)


def test_below_the_rock_nothing_resists():
    drill = Drill(THREE, rock=dataclasses.replace(ROCK, rock_energy_transfer=1.0))
    state = drill.run(1.0, energy=10.0)
    assert (state.depth, drill.borehole.bottom, state.layer) == (2.5e-3, math.inf, "")
    assert drill.borehole.resistance(blow(force=10.0), UNDISTURBED).cutting == 0.0
    assert drill.run(0.1, energy=10.0).depth == 2.5e-3


def test_without_rock_at_the_tool_there_is_no_resistance_and_no_progress():
    drill = Drill()
    state = drill.run(0.2, mount=-0.01)
    assert state.depth == 0.0
    assert drill.rotor.state.torque == 0.0
    assert drill.rotor.state.rate == pytest.approx(DRIVE.rotor_no_load_rate)


def test_too_much_weight_stalls_the_rotor_where_the_torques_say():
    bit = BitParameters(bit_wear_flat=0.0)
    radius = radius_of(ROCK.hole_area)
    # A sharp bit takes the torque a W / (2 zeta).
    limit = 2.0 * bit.bit_thrust_ratio * DRIVE.rotor_stall_torque / radius
    for weight, stalls in ((0.99 * limit, False), (1.01 * limit, True)):
        drill = Drill(bit=bit)
        drill.run(0.2, force=weight)
        assert drill.rotor.state.stalled is stalls


def test_a_drill_that_rotates_keeps_its_flutes_clear_and_one_that_does_not_chokes():
    found = {}
    for rotates in (True, False):
        drill = Drill(bit=BitParameters(), rotates=rotates)
        drill.borehole._depth = drill.borehole._tip = 0.02  # below the start of the hole
        found[rotates] = drill.run(4.0, energy=0.7)
    assert filling(found[True]) < 0.6 < filling(found[False])
    assert found[False].penetration_rate < 0.7 * found[True].penetration_rate


def test_choking_raises_the_torque_and_holds_up_the_progress_and_retracting_clears():
    drill = Drill(bit=BitParameters())
    drill.borehole._depth = drill.borehole._tip = 0.02
    healthy = drill.run(3.0, energy=0.5)
    torque = drill.rotor.state.torque
    choked = drill.run(6.0, energy=0.5, faults=Disturbances(clearing=0.05))
    assert drill.rotor.state.torque > 1.05 * torque
    assert choked.penetration_rate < 0.8 * healthy.penetration_rate
    assert filling(choked) > filling(healthy)
    tip = drill.borehole.state.depth
    for position in np.linspace(tip, 0.0, 50):
        drill.run(STEP, mount=float(position) - 1e-9)
    drill.run(STEP, mount=-1e-9)
    assert drill.borehole.state.packed_cuttings == 0.0
    assert drill.rotor.state.torque == 0.0


def test_the_state_includes_what_a_fault_adds_and_its_end_takes_it_away():
    drill = Drill(bit=BitParameters(bit_wear_rate=0.0))
    healthy = drill.run(0.5, energy=0.15)
    assert healthy.bit_wear == 0.0
    state = drill.run(STEP, faults=Disturbances(clogged=0.9, worn_factor=10.0))
    assert state.bit_wear == pytest.approx(1.0)
    assert filling(state) > 0.9
    assert state.packed_cuttings > 2.0 * healthy.packed_cuttings
    state = drill.run(STEP)
    assert state.bit_wear == 0.0
    assert state.packed_cuttings == pytest.approx(healthy.packed_cuttings, rel=0.15)


def test_a_blunt_bit_wears_on_by_the_work_of_its_friction():
    # The diameter of its flat grows with the distance slid at a constant force: with the work.
    bit = BitParameters(flute_area=1.0, bit_wear_rate=1e-3)
    drill = Drill(bit=bit)
    state = drill.run(2.0)
    diameter = math.sqrt(4e-7 / math.pi) + 1e-3 * 2.0 * drill.rotor.state.work.friction
    grown = math.pi / 4.0 * diameter**2 - 1e-7
    assert state.bit_wear == pytest.approx(grown / (1e-6 - 1e-7), rel=1e-9)
    assert state.bit_wear > 0.1
    assert Drill(bit=bit).run(2.0, mount=-0.01).bit_wear == 0.0


def test_rate_and_specific_energy_are_those_of_the_last_second():
    drill = Drill(rotates=False)
    assert math.isnan(drill.borehole.state.specific_energy)
    drill.run(1.0, energy=0.1)
    depth = drill.borehole.state.depth
    assert drill.borehole.state.penetration_rate == pytest.approx(depth)
    state = drill.run(0.5, energy=0.0)
    assert state.penetration_rate == pytest.approx(0.5 * depth, rel=0.01)
    state = drill.run(0.6, energy=0.0)
    assert state.penetration_rate == 0.0
    assert math.isnan(state.specific_energy)


@pytest.mark.parametrize("faults", [Disturbances(hardness=3.0), Disturbances(progress=0.2)])
def test_hard_rock_and_a_bound_tool_slow_the_progress(faults):
    """Other disturbances have their signatures in test/simulation/test_fault_signatures.py."""
    rates = []
    for acting in (UNDISTURBED, faults):
        drill = Drill(bit=BitParameters())
        drill.run(0.5, energy=0.15)
        rates.append(drill.run(1.0, energy=0.15, faults=acting).penetration_rate)
        assert abs(drill.rotor.state.work.residual) < 1e-12
    assert rates[1] < 0.7 * rates[0]


def test_rock_that_protrudes_into_the_flutes_screws_the_tool_in():
    quiet, screwed = Drill(bit=BitParameters()), Drill(bit=BitParameters())
    for drill in (quiet, screwed):
        drill.run(0.5)
    quiet.run(1.0)
    screwed.run(1.0, faults=Disturbances(screw_torque=0.02))
    turns = [drill.rotor.state.rate for drill in (quiet, screwed)]
    rates = [drill.borehole.state.penetration_rate for drill in (quiet, screwed)]
    assert turns[1] < turns[0]
    assert rates[1] / turns[1] > 1.2 * rates[0] / turns[0]


def test_a_bit_walks_sideways_only_until_the_hole_guides_it():
    drill = Drill(bit=BitParameters())
    walking = drill.run(0.5, energy=0.15, faults=Disturbances(side_walk=1e-3))
    assert walking.side_offset == pytest.approx(0.5e-3)
    drill.borehole._depth = drill.borehole._tip = radius_of(ROCK.hole_area)
    guided = drill.run(0.1, energy=0.15, faults=Disturbances(side_walk=1e-3))
    assert guided.side_offset == walking.side_offset


@settings(max_examples=25)
@given(
    weight=st.floats(0.5, 80.0),
    energy=st.floats(0.0, 0.5),
    name=st.sampled_from(["regolith", "chalk", "limestone", "sandstone", "basalt"]),
    hardness=st.floats(1.0, 5.0),
)
def test_harder_rock_is_never_faster_and_the_account_closes(weight, energy, name, hardness):
    soft, hard = Drill(name, BitParameters()), Drill(name, BitParameters())
    soft.run(0.05, weight, energy)
    hard.run(0.05, weight, energy, faults=Disturbances(hardness=hardness))
    # A rotor that stalls in one and not in the other is another matter.
    if soft.rotor.state.rate > 0.0 and hard.rotor.state.rate >= soft.rotor.state.rate:
        turned = hard.rotor.state.angle / soft.rotor.state.angle
        assert hard.borehole.state.depth <= soft.borehole.state.depth * turned * (1.0 + 1e-9)
    for drill in (soft, hard):
        state, work = drill.borehole.state, drill.rotor.state.work
        assert abs(work.residual) <= 1e-12 * max(work.drive, 1e-6)
        assert 0.0 <= filling(state) <= 1.0 + 1e-12
        assert state.bit_wear >= 0.0


ENDS = [
    (group, name, end)
    for group in (BitParameters, RotationParameters, Layer)
    for name, quantity in quantities(group).items()
    for end in (quantity.minimum, quantity.maximum)
]


@pytest.mark.parametrize(("group", "name", "end"), ENDS)
def test_it_drills_with_each_parameter_at_the_ends_of_its_range(group, name, end):
    values = {BitParameters: {}, RotationParameters: {}, Layer: {}}
    values[group][name] = end
    if name == "bit_wear_flat":
        values[group]["bit_blunt_flat"] = 1e-2
        values[group][name] = min(end, 9e-3)
    elif name == "bit_blunt_flat":
        values[group]["bit_wear_flat"] = 0.0
    elif name == "depth_from":
        values[group][name] = 0.0
    strata = Strata((Layer("one", **values[Layer]), Layer("two", 2e-5)), bottom=1e-2)
    borehole = Borehole(BitParameters(**values[BitParameters]), strata, ROCK, LENGTH)
    rotor = Rotor(dataclasses.replace(DRIVE, **values[RotationParameters]))
    faults = Disturbances(screw_torque=1e-3, extra_torque=1e-3, clearing=0.0)
    for step in range(60):
        acting = faults if step % 2 else UNDISTURBED
        percussion = Percussion((0.2,) * (step % 2), 1.0, True, 0.0, 30.0 * (step % 3))
        resistance = borehole.resistance(percussion, acting)
        turned = rotor.step(STEP, 1.0 + step / 60, resistance)
        borehole.step(STEP, percussion, turned, None, acting)
        found = [
            value for value in dataclasses.astuple(borehole.state) if not isinstance(value, str)
        ]
        assert all(math.isfinite(value) or math.isnan(value) for value in found)
        assert math.isfinite(rotor.state.rate)
        assert math.isfinite(rotor.state.angle)
        work = rotor.state.work
        size = abs(work.drive) + work.resisted + work.kinetic
        assert abs(work.residual) <= 1e-9 * size + 1e-17
