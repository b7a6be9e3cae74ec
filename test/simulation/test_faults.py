"""Faults are checked when they are made; a refusal is one line that says what would do."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import refusal

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.parameters import QUANTITIES
from rpud_sim.simulation import Parameters
from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.fault_kinds import KINDS, FaultEffects
from rpud_sim.simulation.faults import (
    Fault,
    check_supported,
    effects_of,
)
from rpud_sim.simulation.topics import CHANNELS, GROUND_TRUTH

MESSAGE = Path(__file__).parents[2] / "msg_defs" / "msg" / "Fault.msg"
DOCUMENTATION = Path(__file__).parents[2] / "docs" / "reference" / "faults.md"
SIGNAL = [name for name, kind in KINDS.items() if not kind.physical]
PHYSICAL = [name for name, kind in KINDS.items() if kind.physical]


def test_the_kinds_are_those_of_the_message_and_px4_s_are_among_them():
    named = re.findall(r'^string KIND_(\w+) = "(\w+)"', MESSAGE.read_text(), re.MULTILINE)
    assert [name for _, name in named] == list(KINDS)
    assert [constant.lower() for constant, _ in named] == list(KINDS)
    assert {"off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent"} <= {*SIGNAL}


@pytest.mark.parametrize("kind", KINDS)
def test_a_magnitude_that_is_left_open_is_the_default_or_none(kind):
    declared = KINDS[kind]
    for channel in [""] if declared.physical else CHANNELS:
        fault = Fault(kind, channel)
        assert fault == Fault(kind, channel, math.nan) == Fault(kind, channel, fault.magnitude)
        zero = refusal(Fault, kind, channel, 0.0)
        if declared.magnitude is None:
            assert fault.magnitude == 0.0
            assert refusal(Fault, kind, channel, 3).endswith("has no magnitude, given 3")
            assert not zero
        else:
            assert 0.0 < abs(fault.magnitude) < math.inf
            # Zero is a magnitude of its own for those that it does something to.
            takes_zero = kind in ("restitution_loss", "wrong")
            assert ("NaN means the default" in zero) != takes_zero
            assert not (takes_zero and refusal(Fault, kind, channel, 1e-300))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("hard_rok",), "fault kind = 'hard_rok' is unknown; did you mean hard_rock?"),
        (
            ("off", "wrnech"),
            "channel of off = 'wrnech' is unknown; did you mean wrench?",
        ),
        (("choking", "wrench"), "choking is a fault of the drill and has no channel, given 'wr"),
        *(
            (("noise", each), f"noise on {each} is rejected: it is the gro")
            for each in GROUND_TRUTH
        ),
        (
            ("noise", "nodal_plane", -1.0),
            "magnitude of noise on nodal_plane = -1 m is outside its range (0, 1e+06] m; "
            "NaN means the default 0.0001 m",
        ),
        (("bias", "wrench", 0.0), "magnitude of bias on wrench = 0 would change nothing; NaN "),
    ],
)
def test_what_cannot_be_a_fault_is_refused_with_its_name(arguments, complaint):
    assert refusal(Fault, *arguments).startswith(complaint)


JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(),
    st.lists(st.integers(), max_size=20),
    st.sampled_from([*KINDS, *CHANNELS, 10**400]),
)


@given(kind=JUNK, channel=JUNK, magnitude=JUNK)
def test_anything_is_a_fault_or_refused_in_one_short_line(kind, channel, magnitude):
    if found := refusal(Fault, kind, channel, magnitude):
        assert len(found) < 500
    else:
        assert math.isfinite(Fault(kind, channel, magnitude).magnitude)


def test_the_documentation_names_every_channel():
    rows = {}
    for line in DOCUMENTATION.read_text().splitlines():
        if len(cells := line.split("|")) > 3:
            rows.setdefault(cells[1].strip(" `"), cells[2:])
    for name, channel in CHANNELS.items():
        main, default, others = rows[name][:3]
        assert f"`{'.'.join(channel.numbers[0])}` [{channel.unit}]" in main
        assert float(default.split()[0]) == channel.scale
        assert name == "wrench" or all(
            f"`{path[-1]}`" in others for path in (*channel.numbers[1:], *channel.flags)
        )


def inside(quantity):
    """Give any number of a range."""
    ends = {"exclude_min": quantity.exclusive, "exclude_max": quantity.below}
    return st.floats(quantity.minimum, quantity.maximum, **ends)


@st.composite
def faults(draw):
    kind = draw(st.sampled_from(PHYSICAL))
    if (quantity := KINDS[kind].magnitude) is None:
        return Fault(kind)
    return Fault(kind, "", draw(inside(quantity).filter(lambda n: n != KINDS[kind].unchanging)))


any_parameters = st.builds(Parameters, **{name: inside(each) for name, each in QUANTITIES.items()})


def healthy(parameters, **changes):
    """Effects with parameters, and with the load spring rate of the drill's default."""
    rate = Parameters().load_spring_rate
    return FaultEffects(parameters=parameters, pushing_rate=rate, **changes)


def under(*faults, **parameters):
    return effects_of(faults, Parameters(**parameters))


def test_signal_faults_leave_the_drill_as_it_is():
    signals = [Fault(name, "wrench") for name in SIGNAL]
    assert under(*signals) == under() == healthy(Parameters())


@pytest.mark.parametrize(
    ("kind", "magnitude", "parameters", "others"),
    [
        (
            *("restitution_loss", 0.5),
            {
                "actuator_restitution": 0.5 * Parameters().actuator_restitution,
                "drill_tool_restitution": 0.5,
            },
            {},
        ),
        (
            *("load_spring_binding", 4.0),
            {"load_spring_rate": 8000.0, "rpud_damping_ratio": 0.875},
            {},
        ),
        (
            *("drill_tool_binding", 4.0),
            {"restoring_spring_rate": 8000.0, "drill_tool_damping_ratio": 0.875},
            {"progress_factor": 0.25, "progress": 0.25},
        ),
    ],
)
def test_a_fault_of_springs_and_blows_changes_their_parameters(kind, magnitude, parameters, others):
    """What the other kinds do shows in forces, rates and signatures."""
    assert under(Fault(kind, "", magnitude)) == healthy(Parameters(**parameters), **others)


def test_faults_combine():
    found = under(
        Fault("drill_tool_binding", "", 2.0),
        Fault("choking", "", 0.5),
        Fault("restitution_loss", "", 0.5),
    )
    assert found.progress_factor == 0.25
    assert found.parameters.drill_tool_restitution == 0.25


@given(parameters=any_parameters, several=st.lists(faults(), max_size=12))
def test_any_faults_together_leave_valid_effects(several, parameters):
    found = effects_of(several, parameters)
    assert Parameters(**vars(found.parameters)) == found.parameters  # each inside its range
    assert 0.0 <= found.progress_factor <= 1.0
    assert 0.0 <= found.preload_factor <= 1.0
    assert found.hardness >= 1.0
    # Faults make nothing softer, less damped or more elastic.
    for name in ("load_spring_rate", "restoring_spring_rate"):
        assert getattr(found.parameters, name) >= getattr(parameters, name)
    for name in ("rpud_damping_ratio", "drill_tool_damping_ratio"):
        assert 1.0 > getattr(found.parameters, name) >= getattr(parameters, name) * (1 - 1e-15)
    for name in ("actuator_restitution", "drill_tool_restitution"):
        assert getattr(found.parameters, name) <= getattr(parameters, name)


FULL = {
    "actuator_model": "resonance",
    "generator": "tracking",
    "rock_model": "specific_energy",
    "rotation_model": "friction_drive",
    "feed_model": "arm",
}
GAIN = {"actuator_model": "gain", "generator": "fixed"}
NO_ROCK = {"rock_model": "none"}
NO_ROTATION = {"rotation_model": "none"}


@pytest.mark.parametrize(
    ("kind", "lacking", "reason"),
    [
        ("resonance_drift", GAIN, "needs actuator_model = resonance"),
        ("resonance_drift", {"resonance_frequency": 250.0}, "takes the resonance to 50 Hz"),
        ("generator_lock_loss", {"generator": "fixed"}, "needs generator = tracking"),
        ("hard_rock", NO_ROCK, "needs a rock_model, which is none"),
        ("choking", NO_ROCK, "needs a rock_model, which is none"),
        ("drill_tool_binding", NO_ROCK, "acts on the progress while drilling"),
        ("binding", NO_ROTATION, "needs a rotation_model, which is none"),
        ("corkscrewing", NO_ROTATION, "needs a rotation_model, which is none"),
        ("binding", NO_ROCK, "needs strata, or a rotation_model with a rock_model"),
        ("hard_inclusion", NO_ROTATION, "needs strata, or a rotation_model with"),
        ("bit_walk", NO_ROCK, "needs strata, or a rotation_model with"),
        ("worn_bit", {**NO_ROTATION, "strata": "regolith"}, "needs a rotation_model, or strata wi"),
        ("hard_inclusion", {"strata": "basalt"}, "is not harder than any layer: the softest has "),
        ("feed_stall", {"feed_model": "none"}, "needs a feed_model, which is none"),
        ("arm_slip", {"feed_model": "none"}, "needs a feed_model, which is none"),
    ],
)
def test_a_fault_without_effect_is_refused_with_the_reason(kind, lacking, reason):
    check_supported(Fault(kind), to_configuration(FULL))
    with pytest.raises(ParameterError, match=f"^{kind} is not possible: it {reason}"):
        check_supported(Fault(kind), to_configuration({**FULL, **lacking}))


@pytest.mark.parametrize("kind", ["hard_rock", "choking", "drill_tool_binding", "hard_inclusion"])
def test_strata_are_a_rock_and_a_bound_bit_needs_none_before_drilling(kind):
    check_supported(Fault(kind), to_configuration({"strata": "sandstone"}))
    check_supported(Fault("drill_tool_binding"), to_configuration({"regime": "free"}))
