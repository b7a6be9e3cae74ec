"""Commands are checked when they are made, and act unless lost or while the drill is inactive."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation import Parameters
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.control import Control
from rpud_sim.simulation.simulation import Simulation

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
NOMINAL = Drive(True, 100.0, 16000.0)


def made(timeout=0.0, ramp=0.5, active=True, **options):
    simulation = Simulation(Configuration(Parameters(weight_on_bit=10.0), **options))
    control = Control(simulation, timeout, ramp, active)
    control.act()
    return simulation, control


def go_on(simulation, control, time):
    """Advance, and apply what is due; return what ``act`` does."""
    simulation.advance_to(time)
    return control.act()


def acting(simulation):
    drive = simulation.applied.drive
    return simulation.applied.weight_on_bit.force, drive.voltage if drive.enabled else 0.0


def test_a_configuration_without_drive_starts_without_drive():
    simulation, control = made(drive_enabled=False)
    go_on(simulation, control, MILLISECOND)
    assert acting(simulation) == (10.0, 0.0)
    control.apply(NOMINAL)
    assert acting(simulation) == (10.0, 100.0)


def test_lost_commands_ramp_down_are_reported_once_and_come_back_whole():
    simulation, control = made(timeout=0.1, ramp=0.2)
    assert not go_on(simulation, control, 100 * MILLISECOND)
    assert not control.commands_lost
    assert go_on(simulation, control, 150 * MILLISECOND)
    assert control.commands_lost
    assert acting(simulation) == (7.5, 75.0)
    assert not go_on(simulation, control, 200 * MILLISECOND)
    assert acting(simulation) == (5.0, 50.0)
    go_on(simulation, control, 300 * MILLISECOND)
    assert acting(simulation) == (0.0, 0.0)
    # A weight on bit alone shows that there is a commander, and so the drive comes back as well.
    control.apply(WeightOnBit(20.0))
    assert control.act()
    assert not control.commands_lost
    assert acting(simulation) == (20.0, 100.0)
    assert simulation.applied.drive == NOMINAL


def test_a_drive_that_is_off_stays_off_when_commands_come_back():
    simulation, control = made(timeout=0.1, ramp=0.1)
    control.apply(Drive(False, 0.0, 0.0))
    go_on(simulation, control, SECOND)
    assert acting(simulation) == (0.0, 0.0)
    control.apply(WeightOnBit(20.0))
    control.act()
    assert acting(simulation) == (20.0, 0.0)
    control.apply(Drive(True, 80.0, 16000.0))
    assert acting(simulation) == (20.0, 80.0)


def test_the_watchdog_does_not_wait_while_inactive():
    simulation, control = made(timeout=0.1, ramp=0.1, active=False)
    assert not go_on(simulation, control, SECOND)
    assert not control.commands_lost
    control.activate(True)
    assert not control.act()
    assert acting(simulation) == (10.0, 100.0)
    assert go_on(simulation, control, SECOND + 150 * MILLISECOND)
    assert control.commands_lost


def test_another_timeout_holds_from_now_on():
    simulation, control = made()
    go_on(simulation, control, SECOND)
    control.set(0.5, 0.0)
    assert control.act()
    assert acting(simulation) == (0.0, 0.0)
    control.set(0.0, 0.0)
    assert control.act()
    assert acting(simulation) == (10.0, 100.0)


commands = st.one_of(
    st.builds(WeightOnBit, st.floats(0.0, 60.0)),
    st.builds(Drive, st.just(True), st.floats(0.0, 200.0), st.floats(8e3, 40e3)),
    st.just(Drive(False, 0.0, 0.0)),
)


@settings(max_examples=examples(50))
@given(st.lists(st.one_of(commands, st.booleans(), st.integers(1, 400)), min_size=1, max_size=20))
def test_it_never_acts_more_than_commanded_and_not_at_all_while_inactive(events):
    simulation, control = made(timeout=0.05, ramp=0.1)
    weight_on_bit, drive = simulation.applied.weight_on_bit, simulation.applied.drive
    for event in events:
        if isinstance(event, bool):
            if event and not control.active:
                weight_on_bit, drive = WeightOnBit(10.0), NOMINAL
            control.activate(event)
        elif isinstance(event, int):
            simulation.advance_to(simulation.time + event * MILLISECOND)
        else:
            control.apply(event)
            if control.active and isinstance(event, WeightOnBit):
                weight_on_bit = event
            elif control.active:
                drive = Drive(
                    event.enabled,
                    event.voltage if event.enabled else drive.voltage,
                    event.frequency or drive.frequency,
                )
        control.act()
        force, voltage = acting(simulation)
        if not control.active:
            assert (force, voltage) == (0.0, 0.0)
        elif control.commands_lost:
            assert force <= weight_on_bit.force
            assert voltage <= (drive.voltage if drive.enabled else 0.0)
        else:
            assert force == weight_on_bit.force
            assert simulation.applied.drive.enabled == drive.enabled
            assert voltage == (drive.voltage if drive.enabled else 0.0)


def test_the_share_goes_down_linearly_after_the_timeout():
    simulation, control = made(timeout=0.5, ramp=2.0)
    shares, lost = [], []
    for half in range(8):
        go_on(simulation, control, half * SECOND // 2)
        shares.append(acting(simulation)[0] / 10.0)
        lost.append(control.commands_lost)
    assert shares == [1.0, 1.0, 0.75, 0.5, 0.25, 0.0, 0.0, 0.0]
    assert lost == [False, False, *[True] * 6]


def test_the_shortest_timeout_is_one():
    simulation, control = made(timeout=1e-15, ramp=0.0)
    go_on(simulation, control, 2)
    assert control.commands_lost


NO_NUMBERS = [math.nan, math.inf, -math.inf, True, "30", None, [30.0], 10**400]


def test_a_refusal_names_value_unit_and_range():
    with pytest.raises(ParameterError) as caught:
        WeightOnBit(-1.5)
    assert str(caught.value) == "weight_on_bit = -1.5 N is outside its range [0, 1000] N"
    with pytest.raises(ParameterError) as caught:
        Drive(True, 2000.0, 16000.0)
    assert str(caught.value) == "drive voltage = 2000 V is outside its range [0, 1000] V"
    with pytest.raises(ParameterError) as caught:
        Drive(True, 100.0, 0.0)
    assert str(caught.value) == "drive frequency = 0 Hz is outside its range [100, 200000] Hz"


@pytest.mark.parametrize("enabled", [True, False])
@pytest.mark.parametrize("value", [*NO_NUMBERS, -1.0, 1e9])
def test_a_voltage_or_frequency_outside_its_range_is_refused_even_when_off(enabled, value):
    with pytest.raises(ParameterError, match=r"^drive voltage = .* V is outside its range"):
        Drive(enabled, value, 16000.0)
    with pytest.raises(ParameterError, match=r"^drive frequency = .* Hz is outside its range"):
        Drive(enabled, 100.0, value)


@pytest.mark.parametrize("enabled", [1, 0, "true", None, math.nan])
def test_enabled_is_true_or_false(enabled):
    with pytest.raises(ParameterError, match=r"drive enabled = .* is not true or false"):
        Drive(enabled, 100.0, 16000.0)


@pytest.mark.parametrize("frequency", [0, 0.0, -0.0])
def test_a_drive_that_is_off_needs_no_voltage_and_no_frequency(frequency):
    drive = Drive(False, 0, frequency)
    assert (drive.voltage, drive.frequency) == (0.0, 0.0)
    assert type(drive.frequency) is float
