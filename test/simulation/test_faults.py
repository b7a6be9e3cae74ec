"""Faults are checked when they are made; a refusal is one line that says what would do."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.inputs import Disturbances
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.parameters import QUANTITIES
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.configuration import to_configuration
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import (
    MOST_DAMPING_RATIO,
    Fault,
    FaultEffects,
    FaultError,
    check_supported,
    effects_of,
)
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
        (("hard_rok",), "fault kind = 'hard_rok' is unknown (did you mean hard_rock?)"),
        (
            ("off", "wrnech"),
            "channel of off = 'wrnech' is not one of nodal_plane, drill_tool, reacting_force, "
            "wrench, contact_force, rotation, mount (did you mean wrench?)",
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


PHYSICAL = [name for name, kind in KINDS.items() if kind.physical]


@st.composite
def faults(draw):
    kind = draw(st.sampled_from(PHYSICAL))
    quantity = KINDS[kind].magnitude
    if quantity is None:
        return Fault(kind)
    magnitude = draw(
        st.floats(
            quantity.minimum,
            quantity.maximum,
            exclude_min=quantity.exclusive,
            exclude_max=quantity.below,
        ).filter(lambda number: number != KINDS[kind].unchanging)
    )
    return Fault(kind, "", magnitude)


@st.composite
def any_parameters(draw):
    return Parameters(
        **{
            name: draw(
                st.floats(
                    quantity.minimum,
                    quantity.maximum,
                    exclude_min=quantity.exclusive,
                    exclude_max=quantity.below,
                )
            )
            for name, quantity in QUANTITIES.items()
        }
    )


def healthy(parameters, **changes):
    """Conditions with parameters, and with the load spring rate of the drill's default."""
    return FaultEffects(parameters, Parameters().load_spring_rate, **changes)


def test_signal_faults_leave_the_drill_as_it_is():
    signals = [Fault(name, "wrench") for name, kind in KINDS.items() if not kind.physical]
    for acting in ((), signals):
        assert effects_of(acting, preset("drilling")) == healthy(preset("drilling"))


def under(*faults, **parameters):
    return effects_of(faults, Parameters(**parameters))


def test_each_kind_acts_where_it_should():
    assert under(Fault("free_mass_jammed")) == healthy(Parameters(), jammed=True)
    assert under(Fault("lost_preload", "", 0.25)) == healthy(
        Parameters(), disturbances=Disturbances(preload_factor=0.75)
    )
    assert under(Fault("hard_rock", "", 4.0)) == healthy(
        Parameters(), disturbances=Disturbances(hardness=4.0)
    )
    assert under(Fault("resonance_drift", "", -300.0)) == healthy(
        Parameters(), resonance_offset=-300.0
    )
    assert under(Fault("choking", "", 0.75)) == healthy(
        Parameters(drill_tool_restitution=0.25),
        progress_factor=0.25,
        disturbances=Disturbances(clearing=0.25, clogged=0.75),
    )
    assert under(Fault("restitution_loss", "", 0.5), actuator_restitution=0.5) == healthy(
        Parameters(actuator_restitution=0.25, drill_tool_restitution=0.5)
    )
    assert under(Fault("load_spring_binding", "", 4.0)) == healthy(
        Parameters(load_spring_rate=8000.0, rpud_damping_ratio=0.875)
    )
    assert under(Fault("drill_tool_binding", "", 4.0)) == healthy(
        Parameters(restoring_spring_rate=8000.0, drill_tool_damping_ratio=0.875),
        progress_factor=0.25,
        disturbances=Disturbances(progress=0.25),
    )


@pytest.mark.parametrize(
    ("fault", "disturbances"),
    [
        (Fault("binding", "", 0.3), Disturbances(extra_torque=0.3)),
        (Fault("hard_inclusion", "", 1e8), Disturbances(inclusion_strength=1e8)),
        (Fault("corkscrewing", "", 0.01), Disturbances(screw_torque=0.01)),
        (Fault("bit_walk", "", 1e-3), Disturbances(side_walk=1e-3)),
        (Fault("feed_stall"), Disturbances(feed_stalled=True)),
        (Fault("arm_slip", "", 1e-3), Disturbances(arm_slip_rate=1e-3)),
        (Fault("worn_bit", "", 4.0), Disturbances(worn_factor=4.0)),
    ],
)
def test_a_fault_of_the_hole_or_the_feed_leaves_the_percussion_as_it_is(fault, disturbances):
    assert under(fault) == healthy(Parameters(), disturbances=disturbances)


def test_faults_combine():
    found = under(
        Fault("drill_tool_binding", "", 2.0),
        Fault("choking", "", 0.5),
        Fault("restitution_loss", "", 0.5),
    )
    assert found.progress_factor == 0.25
    assert found.parameters.drill_tool_restitution == 0.25
    assert found.parameters.actuator_restitution == 0.5 * Parameters().actuator_restitution


def test_a_parameter_that_would_leave_its_range_takes_its_end():
    binding = Fault("load_spring_binding", "", 1000.0)
    found = under(binding, load_spring_rate=1e6)
    assert found.parameters.load_spring_rate == QUANTITIES["load_spring_rate"].maximum
    assert found.parameters.rpud_damping_ratio == MOST_DAMPING_RATIO
    # A drill that is damped more than that stays as it is.
    assert under(binding, rpud_damping_ratio=0.995).parameters.rpud_damping_ratio == 0.995


@given(parameters=any_parameters(), several=st.lists(faults(), max_size=12))
def test_any_faults_together_leave_valid_effects_of(several, parameters):
    found = effects_of(several, parameters)
    assert Parameters(**vars(found.parameters)) == found.parameters  # each inside its range
    assert 0.0 <= found.progress_factor <= 1.0
    assert 0.0 <= found.disturbances.preload_factor <= 1.0
    assert found.disturbances.hardness >= 1.0
    assert math.isfinite(found.resonance_offset)
    assert found.parameters.weight_on_bit == parameters.weight_on_bit
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


@pytest.mark.parametrize(
    ("kind", "lacking", "reason"),
    [
        (
            "resonance_drift",
            {"actuator_model": "gain", "generator": "fixed"},
            "needs actuator_model = resonance",
        ),
        ("generator_lock_loss", {"generator": "fixed"}, "needs generator = tracking"),
        ("resonance_drift", {"resonance_frequency": 250.0}, "takes the resonance to 50 Hz"),
        ("hard_rock", {"rock_model": "none"}, "needs a rock_model, which is none"),
        ("choking", {"rock_model": "none"}, "needs a rock_model, which is none"),
        ("drill_tool_binding", {"rock_model": "none"}, "acts on the progress while drilling"),
        ("binding", {"rotation_model": "none"}, "needs a rotation_model, which is none"),
        ("corkscrewing", {"rotation_model": "none"}, "needs a rotation_model, which is none"),
        ("binding", {"rock_model": "none"}, "needs strata, or a rotation_model with a rock_model"),
        ("hard_inclusion", {"rotation_model": "none"}, "needs strata, or a rotation_model with"),
        ("bit_walk", {"rock_model": "none"}, "needs strata, or a rotation_model with"),
        (
            "worn_bit",
            {"rotation_model": "none", "strata": "regolith"},
            "needs a rotation_model, or strata with a threshold_energy",
        ),
        ("hard_inclusion", {"strata": "basalt"}, "is not harder than any layer: the softest has "),
        ("feed_stall", {"feed_model": "none"}, "needs a feed_model, which is none"),
        ("arm_slip", {"feed_model": "none"}, "needs a feed_model, which is none"),
    ],
)
def test_a_fault_without_effect_is_refused_with_the_reason(kind, lacking, reason):
    check_supported(Fault(kind), to_configuration(FULL))
    with pytest.raises(FaultError, match=f"^{kind} cannot be honoured: it {reason}"):
        check_supported(Fault(kind), to_configuration({**FULL, **lacking}))


def test_a_bound_bit_needs_no_rock_before_drilling():
    check_supported(Fault("drill_tool_binding"), to_configuration({"regime": "free"}))


@pytest.mark.parametrize("kind", ["hard_rock", "choking", "drill_tool_binding", "hard_inclusion"])
def test_strata_are_a_rock(kind):
    check_supported(Fault(kind), to_configuration({"strata": "sandstone"}))
