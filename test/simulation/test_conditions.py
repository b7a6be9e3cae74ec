"""What faults make of the drill; whatever comes together, the drill can still be computed."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.inputs import Disturbances
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


def test_without_faults_nothing_changes():
    assert effects_of((), preset("free")) == healthy(preset("free"))


def test_signal_faults_leave_the_drill_as_it_is():
    signals = [Fault(name, "wrench") for name, kind in KINDS.items() if not kind.physical]
    assert effects_of(signals, preset("drilling")) == healthy(preset("drilling"))


def under(*faults, **parameters):
    return effects_of(faults, Parameters(**parameters))


def test_each_kind_acts_where_it_should():
    assert under(Fault("free_mass_jammed")) == healthy(Parameters(), jammed=True)
    assert under(Fault("lost_preload", "", 0.25)) == healthy(
        Parameters(), preload_factor=0.75, disturbances=Disturbances(preload_factor=0.75)
    )
    assert under(Fault("hard_rock", "", 4.0)) == healthy(
        Parameters(), specific_energy_factor=4.0, disturbances=Disturbances(hardness=4.0)
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
    assert 0.0 <= found.preload_factor <= 1.0
    assert found.specific_energy_factor >= 1.0
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
