"""The borehole deepens by percussion and rotation, layer by layer, and wears the bit."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.borehole import BitParameters, Borehole, cut, radius_of
from rpud_sim.drilling.inputs import UNDISTURBED, Disturbances, Percussion
from rpud_sim.drilling.rock import Layer, RockParameters, Strata, find_strata, uniform_strata
from rpud_sim.drilling.rotor import NOT_TURNED, RotationParameters, Rotor
from rpud_sim.foundation.quantities import quantities

ROCK = RockParameters()
WHOLE = dataclasses.replace(ROCK, rock_energy_transfer=1.0)
RADIUS = radius_of(ROCK.hole_area)
STEP = 1e-3  # s
LENGTH = 0.09  # of the drill tool [m]
BIT = BitParameters()
# Flutes so wide that cuttings never matter, and a bit without wear flats.
CLEAR = BitParameters(flute_area=1.0, bit_wear_flat=0.0)
DRIVE = RotationParameters(rotation_model="friction_drive")
(SANDSTONE,) = find_strata("sandstone").layers


class Drill:
    """Rotor and borehole, stepped as the process does."""

    def __init__(self, strata="sandstone", bit=CLEAR, rotates=True, rock=ROCK, deep=0.0):
        layers = find_strata(strata) if isinstance(strata, str) else strata
        self.borehole = Borehole(bit, layers, rock, LENGTH)
        self.borehole._depth = self.borehole._tip = deep
        self.rotor = Rotor(DRIVE) if rotates else None
        self.steps = 0

    def run(self, seconds, force=10.0, energy=0.0, mount=None, faults=UNDISTURBED):
        """Drill with one impact in each 4 ms, of an energy [J]."""
        in_rock = mount is None or mount >= self.borehole.bottom
        for _ in range(round(seconds / STEP)):
            self.steps += 1
            impacts = int(energy > 0.0 and self.steps % 4 == 0)
            percussion = Percussion((energy,) * impacts, 1.0, in_rock, 0.0, force * in_rock)
            turned = NOT_TURNED
            if self.rotor:
                resistance = self.borehole.resistance(percussion, faults)
                turned = self.rotor.step(STEP, 1.0, resistance)
            self.borehole.step(STEP, percussion, turned, mount, faults)
        return self.borehole.state


def struck(*steps, strata="sandstone", bit=CLEAR, rock=ROCK):
    """State of a hole after steps of the given impact energies [J], without rotation."""
    layers = find_strata(strata) if isinstance(strata, str) else strata
    borehole = Borehole(bit, layers, rock, LENGTH)
    for energies in steps:
        percussion = Percussion(tuple(energies), 1.0, True)
        borehole.step(STEP, percussion, NOT_TURNED, None, UNDISTURBED)
    return borehole.state


@given(st.lists(st.floats(-0.01, 0.1), min_size=1, max_size=8), st.floats(0.0, 0.08))
def test_impacts_break_by_what_exceeds_the_threshold_however_steps_divide_them(energies, threshold):
    strata = Strata((dataclasses.replace(SANDSTONE, threshold_energy=threshold),))
    breaking = math.fsum(max(0.0, energy - threshold) for energy in energies)
    depth = ROCK.rock_energy_transfer * breaking / (75e6 * ROCK.hole_area)
    found = [struck(*each, strata=strata).depth for each in ([energies], [[e] for e in energies])]
    assert found[0] == found[1] == pytest.approx(depth, rel=1e-12)


@given(st.lists(st.lists(st.floats(-0.1, 0.1), max_size=4), min_size=1, max_size=8))
def test_the_specific_energy_is_never_negative(steps):
    """A squeezed mass gives energy back; that is none which tool and rock absorb."""
    found = struck(*steps, strata="regolith")
    assert math.isnan(found.specific_energy) or found.specific_energy > 0.0
    if not any(energy > 0.0 for step in steps for energy in step):
        assert math.isnan(found.specific_energy)


def test_impacts_that_choke_hold_each_other_up_however_steps_divide_them():
    depths = [
        struck(*[[0.5] * count] * (300 // count), strata="chalk", bit=BIT).depth
        for count in (1, 6)  # impacts in a step
    ]
    free = 300 * 0.498 * ROCK.rock_energy_transfer / (10e6 * ROCK.hole_area)
    assert depths[0] == depths[1] < 0.9 * free


def test_by_rotation_the_rate_is_the_depth_of_cut_times_the_turns():
    drill = Drill()
    drill.run(0.1)
    state, rotor = drill.run(1.0), drill.rotor.state
    done = cut(CLEAR, SANDSTONE, RADIUS, 10.0, 0.0)
    assert state.penetration_rate == pytest.approx(done.depth * rotor.rate / (2 * math.pi), 1e-6)
    assert rotor.torque == pytest.approx(done.cutting_torque, rel=1e-8)


def test_the_least_specific_energy_is_the_rocks_by_a_sharp_bit_and_by_percussion():
    # e = F / A + 2 pi N T / (A u): the thrust adds zeta d / (pi a), which is small for fine cuts.
    sharp = dataclasses.replace(CLEAR, bit_thrust_ratio=0.01)
    assert Drill(bit=sharp).run(1.5, force=0.2).specific_energy == pytest.approx(75e6, rel=2e-4)
    hammer = Drill(uniform_strata(75e6), rotates=False, rock=WHOLE)
    assert hammer.run(1.2, force=0.0, energy=0.1).specific_energy == pytest.approx(75e6, rel=1e-9)


THREE = Strata(
    (Layer("soft", 0.0, 1e6, 1e6), Layer("middle", 1e-3, 1e7, 1e7), Layer("hard", 2e-3, 1e8, 1e8)),
    bottom=2.5e-3,
)


@pytest.mark.parametrize(
    ("energy", "depth", "name"),  # of the layers: 20 mJ, 200 mJ, 1000 mJ
    [(0.02, 1e-3, "middle"), (0.12, 1.5e-3, "middle"), (0.72, 2.25e-3, "hard"), (1.5, 2.5e-3, "")],
)
def test_layers_are_crossed_at_their_depths_also_within_one_step(energy, depth, name):
    for steps in ([[energy]], [[energy / 7]] * 7):
        state = struck(*steps, strata=THREE, rock=WHOLE)
        assert (state.depth, state.layer) == (pytest.approx(depth, rel=1e-12), name)


def test_below_the_rock_and_without_rock_at_the_tool_nothing_resists():
    through = Drill(THREE, rock=WHOLE)
    through.run(1.0, energy=10.0)
    away = Drill()
    for drill, mount, depth, bottom in ((through, None, 2.5e-3, math.inf), (away, -0.01, 0.0, 0.0)):
        state = drill.run(0.2, energy=10.0, mount=mount)
        assert (state.depth, drill.borehole.bottom) == (depth, bottom)
        assert drill.rotor.state.torque == pytest.approx(0.0, abs=1e-9)
        assert drill.rotor.state.rate == pytest.approx(DRIVE.rotor_no_load_rate)


@pytest.mark.parametrize(("share", "stalls"), [(0.99, False), (1.01, True)])
def test_too_much_weight_stalls_the_rotor_where_the_torques_say(share, stalls):
    drill = Drill(bit=BitParameters(bit_wear_flat=0.0))
    # A sharp bit takes the torque a W / (2 zeta).
    drill.run(0.2, force=share * 2.0 * 0.6 * DRIVE.rotor_stall_torque / RADIUS)
    assert drill.rotor.state.stalled is stalls


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


# What must not be at the same end, by parameter.
BESIDE = {"bit_wear_flat": {"bit_blunt_flat": 1e-2}, "bit_blunt_flat": {"bit_wear_flat": 0.0}}
ENDS = [
    (group, {**BESIDE.get(name, {}), name: 9e-3 if name == "bit_wear_flat" and end else end})
    for group in (BitParameters, RotationParameters, Layer)
    for name, quantity in quantities(group).items()
    for end in (quantity.minimum, quantity.maximum)
    if name != "depth_from"
]


@pytest.mark.parametrize(("group", "values"), ENDS)
def test_it_drills_with_each_parameter_at_the_ends_of_its_range(group, values):
    one = Layer("one", **(values if group is Layer else {}))
    bit = BitParameters(**values) if group is BitParameters else BIT
    borehole = Borehole(bit, Strata((one, Layer("two", 2e-5)), bottom=1e-2), ROCK, LENGTH)
    drive = values if group is RotationParameters else {}
    rotor = Rotor(dataclasses.replace(DRIVE, **drive))
    faults = Disturbances(screw_torque=1e-3, extra_torque=1e-3, clearing=0.0)
    for step in range(60):
        acting = faults if step % 2 else UNDISTURBED
        percussion = Percussion((0.2,) * (step % 2), 1.0, True, 0.0, 30.0 * (step % 3))
        turned = rotor.step(STEP, 1.0 + step / 60, borehole.resistance(percussion, acting))
        borehole.step(STEP, percussion, turned, None, acting)
        found = [rotor.state.rate, rotor.state.angle, *dataclasses.astuple(borehole.state)]
        assert not any(math.isinf(value) for value in found if not isinstance(value, str))
        work = rotor.state.work
        size = abs(work.drive) + work.resisted + work.kinetic
        assert abs(work.residual) <= 1e-9 * size + 1e-17
