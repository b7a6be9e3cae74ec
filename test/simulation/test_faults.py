"""Faults are checked when they are made; a refusal is one line that says what would do."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.topics import CHANNELS, GROUND_TRUTH

MESSAGE = Path(__file__).parents[2] / "msg_defs" / "msg" / "Fault.msg"
DOCUMENTATION = Path(__file__).parents[2] / "docs" / "reference" / "faults.md"
SIGNAL = [name for name, kind in KINDS.items() if not kind.physical]


def test_the_kinds_are_those_of_the_message():
    named = re.findall(r'^string KIND_(\w+) = "(\w+)"', MESSAGE.read_text(), re.MULTILINE)
    assert [name for _, name in named] == list(KINDS)
    assert [constant.lower() for constant, _ in named] == list(KINDS)


def test_all_of_px4_s_failures_are_there():
    assert {"off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent"} <= {*SIGNAL}


@pytest.mark.parametrize("kind", KINDS)
def test_without_a_magnitude_a_fault_has_its_kind_s_default_inside_the_range(kind):
    for channel in [""] if KINDS[kind].physical else CHANNELS:
        fault = Fault(kind, channel)
        assert math.isfinite(fault.magnitude)
        assert fault == Fault(kind, channel, math.nan) == Fault(kind, channel, fault.magnitude)
        quantity = KINDS[kind].quantity_on(channel)
        assert (quantity is None) == (fault.magnitude == 0.0)


@pytest.mark.parametrize("kind", ["free_mass_jammed", "feed_stall", "off", "stuck", "garbage"])
def test_a_kind_without_magnitude_accepts_the_default_of_a_message_alone(kind):
    channel = "" if KINDS[kind].physical else "wrench"
    assert Fault(kind, channel, 0.0) == Fault(kind, channel, math.nan)
    with pytest.raises(FaultError, match=r"has no magnitude, given 3$"):
        Fault(kind, channel, 3)


def test_zero_is_a_magnitude_of_its_own_for_those_that_it_does_something_to():
    assert {name for name, kind in KINDS.items() if kind.takes_zero} == {
        "restitution_loss",
        "wrong",
    }
    for name, kind in KINDS.items():
        channel = "" if kind.physical else "wrench"
        if kind.takes_zero:
            assert Fault(name, channel, 0.0).magnitude == 0.0
        elif kind.magnitude is not None:
            with pytest.raises(FaultError, match="NaN stands for the default"):
                Fault(name, channel, 0.0)


def test_noise_and_bias_are_in_the_unit_of_their_channel():
    assert Fault("noise", "nodal_plane").magnitude < 1e-3 < Fault("noise", "wrench").magnitude
    with pytest.raises(FaultError) as caught:
        Fault("noise", "nodal_plane", -1.0)
    assert str(caught.value) == (
        "magnitude of noise on nodal_plane = -1 m is outside its range (0, 1e+06] m; "
        "NaN stands for the default 0.0001 m"
    )


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (
            ("rusty",),
            "fault kind = 'rusty' is unknown; possible are free_mass_jammed, ",
        ),
        ((None,), "fault kind = None is unknown; possible are "),
        ((["off"],), "fault kind = ['off'] is unknown; possible are "),
        (("choking", "wrench"), "choking is a fault of the drill and has no channel, given 'wr"),
        (("off",), "channel of off = '' is not one of nodal_plane, drill_tool, "),
        (("off", "status"), "channel of off = 'status' is not one of "),
        (("off", ["wrench"]), "channel of off = ['wrench'] is not one of "),
        (("off", "waveform"), "off on waveform is refused: it is the ground truth; "),
        (("lost_preload", "", 0.0), "magnitude of lost_preload = 0 is outside its range (0, 1]; "),
        (("bias", "wrench", 0.0), "magnitude of bias on wrench = 0 would change nothing; NaN "),
        (("resonance_drift", "", 0), "magnitude of resonance_drift = 0 would change nothing; "),
        (("wrong", "wrench", 1), "magnitude of wrong on wrench = 1 would change nothing; "),
        (("hard_rock", "", math.inf), "magnitude of hard_rock = inf is outside its range "),
        (("hard_rock", "", 10**5000), "magnitude of hard_rock = inf is outside its range "),
        (("hard_rock", "", "2"), "magnitude of hard_rock = '2' is not a number"),
        (("hard_rock", "", True), "magnitude of hard_rock = True is not a number"),
    ],
)
def test_what_cannot_be_a_fault_is_refused_with_its_name(arguments, complaint):
    with pytest.raises(FaultError) as caught:
        Fault(*arguments)
    assert str(caught.value).startswith(complaint)


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (("hard_rok",), "(did you mean hard_rock?)"),
        (("off", "wrnech"), "(did you mean wrench?)"),
    ],
)
def test_a_misspelt_name_is_answered_with_the_nearest_one(arguments, hint):
    with pytest.raises(FaultError) as caught:
        Fault(*arguments)
    assert hint in str(caught.value)


@pytest.mark.parametrize("channel", GROUND_TRUTH)
@pytest.mark.parametrize("kind", SIGNAL)
def test_the_ground_truth_never_fails(kind, channel):
    with pytest.raises(FaultError, match="ground truth"):
        Fault(kind, channel)


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
def test_anything_else_is_refused_in_one_short_line(kind, channel, magnitude):
    try:
        fault = Fault(kind, channel, magnitude)
    except ParameterError as error:
        refusal = error
    else:
        assert math.isfinite(fault.magnitude)
        return
    assert isinstance(refusal, FaultError)
    assert "\n" not in str(refusal)
    assert len(str(refusal)) < 500


def test_the_documentation_names_every_channel():
    rows = {}
    for line in DOCUMENTATION.read_text().splitlines():
        if len(cells := line.split("|")) > 3:
            rows.setdefault(cells[1].strip(" `"), cells[2:])
    assert {*CHANNELS} <= {*rows}
    for name, channel in CHANNELS.items():
        main, default, others = rows[name][:3]
        assert f"`{'.'.join(channel.numbers[0])}` [{channel.unit}]" in main
        assert float(default.split()[0]) == channel.scale
        assert name == "wrench" or all(
            f"`{path[-1]}`" in others for path in (*channel.numbers[1:], *channel.flags)
        )
