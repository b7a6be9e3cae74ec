"""What goes out of the blocks of a run is complete, at its times, and does not depend on them."""

import itertools

import numpy as np
import pytest

from rpud_sim.simulation import ActuatorParameters, Configuration, Parameters, fields
from rpud_sim.simulation.block import boundary
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.scenario import Scenario, ScheduledFault
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.telemetry import Telemetry, messages_of

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
END = 200 * MILLISECOND
ORIGIN = 1_700_000_000 * SECOND + 5
SENSORS = ("nodal_plane", "drill_tool", "reacting_force", "wrench")


def periods(rate, end=END):
    """The ends of all telemetry periods until a time."""
    numbers = itertools.count(1)
    return list(itertools.takewhile(lambda time: time <= end, (boundary(n, rate) for n in numbers)))


def made(telemetry_rate=100, sample_rate=50_000, block_duration=0.05, **options):
    rates = {"telemetry_rate": telemetry_rate, "sample_rate": sample_rate}
    return Telemetry(to_settings({**rates, "block_duration": block_duration}), **options)


def everything(telemetry, block, faults):
    yield from telemetry.prompt(block, faults)
    yield from messages_of(telemetry.streams(block))


def told(telemetry, times, faults=(), simulation=None):
    """Everything that goes out until the last of the times, as (time, message) by topic."""
    if simulation is None:
        simulation = Simulation(Parameters(), scenario=Scenario(0, tuple(faults)))
    found = {}
    for time in times:
        block = simulation.advance_to(time)
        for out, topic, values in everything(
            telemetry, block, simulation.faults.since(block.start)
        ):
            assert block.start <= out <= block.end
            found.setdefault(topic, []).append((out, values))
    for out, topic, values in telemetry.flush():
        found.setdefault(topic, []).append((out, values))
    return found


def stamps(messages):
    return [fields.stamp_of(values) for _, values in messages]


@pytest.mark.parametrize("rate", [100, 333, 1000])
def test_sensors_are_sampled_at_the_boundaries_alone(rate):
    times = sorted({*periods(rate), *range(7_654_321, END, 7_654_321), END})
    telemetry = made(rate)
    telemetry.origin = ORIGIN
    found = told(telemetry, times)
    whole = Simulation(Parameters()).advance_to(END)
    due = periods(rate)
    samples = whole.sample(Times.from_nanoseconds(np.array(due)))
    for topic in (*SENSORS, "joint_states"):
        assert [time for time, _ in found[topic]] == due
        assert stamps(found[topic]) == [ORIGIN + time for time in due]
    for index, (_, values) in enumerate(found["nodal_plane"]):
        assert values["position"] == samples.nodal_plane_position[index]


def test_the_state_of_the_actuator_is_complete_and_its_powers_add_up():
    resonant = ActuatorParameters(actuator_model="resonance")
    times = sorted({*periods(100), *range(7_654_321, END, 7_654_321), END})
    simulation = Simulation(Configuration(actuator=resonant))
    states = told(made(), times, simulation=simulation)["actuator_state"]
    assert [time for time, _ in states] == periods(100)
    work = sum(values["mechanical_power"] * 0.01 for _, values in states)
    last = states[-1][1]
    assert work == pytest.approx(last["mechanical_work"], rel=1e-12)
    assert last["mechanical_work"] < last["electrical_energy"]
    assert last["impedance"] == pytest.approx(last["voltage"] / last["current"])
    power = 0.5 * last["voltage"] * last["current"] * np.cos(last["phase"])
    assert last["electrical_power"] == pytest.approx(power)
    unknown = told(made(), times)["actuator_state"][-1][1]
    assert (unknown["voltage"], unknown["amplitude"]) == (100.0, 20e-6)
    assert np.isnan(
        [unknown["current"], unknown["electrical_power"], unknown["mechanical_power"]]
    ).all()


def test_every_impact_is_told_once_and_in_order():
    found = told(made(), [*periods(100), END])["contact_force"]
    impacts = Simulation(Parameters()).advance_to(END).impacts
    for name in ("sequence", "peak_force"):
        assert [values[name] for _, values in found] == impacts[name].tolist()
    times = [time for time, _ in found]
    assert times == sorted(times)


def test_streams_come_in_blocks_without_a_gap_and_the_rest_at_the_end():
    end = END - 3_210_987
    found = told(made(100, 48_000, 0.03), [*periods(100, end), end])
    whole = Simulation(Parameters()).advance_to(end)
    ends = [30, 60, 90, 120, 150, 180]
    assert [time for time, _ in found["waveform"]] == [ms * MILLISECOND for ms in ends] + [end]
    lengths = [len(values["contact_force"]) for _, values in found["waveform"]]
    assert lengths[:-1] == [1440] * 6
    sequences = [values["sequence"] for _, values in found["waveform"]]
    assert sequences == [0, *itertools.accumulate(lengths[:-1])]
    samples = whole.sample(Times.from_grid(0, sum(lengths), 48_000))
    forces = np.concatenate([values["contact_force"] for _, values in found["waveform"]])
    assert (forces == samples.contact_force).all()
    counts = [len(values["duration"]) for _, values in found["trajectory"]]
    sequences = [values["sequence"] for _, values in found["trajectory"]]
    assert sequences == [0, *itertools.accumulate(counts[:-1])]
    assert sum(counts) == len(whole.segments)


FAULTS = (
    ScheduledFault(0, None, Fault("noise", "wrench")),
    ScheduledFault(20 * MILLISECOND, 95 * MILLISECOND, Fault("delayed", "nodal_plane", 0.03)),
    ScheduledFault(50 * MILLISECOND, None, Fault("slow", "drill_tool", 0.025)),
    ScheduledFault(70 * MILLISECOND, 130 * MILLISECOND, Fault("off", "reacting_force")),
)


def test_faults_act_on_their_channel_and_the_ground_truth_stays():
    healthy, faulty = (told(made(), periods(100), faults) for faults in ((), FAULTS))
    for topic in ("waveform", "trajectory", "joint_states", "contact_force"):
        assert repr(faulty[topic]) == repr(healthy[topic])
    assert stamps(faulty["wrench"]) == stamps(healthy["wrench"])
    assert faulty["wrench"] != healthy["wrench"]
    silent = [time for time in periods(100) if 70 * MILLISECOND <= time < 130 * MILLISECOND]
    kept = [message for message in healthy["reacting_force"] if message[0] not in silent]
    assert faulty["reacting_force"] == kept
    slow = [time // MILLISECOND for time, _ in faulty["drill_tool"]]
    assert slow == [10, 20, 30, 40, 50, 80, 110, 140, 170, 200]
    # The fault begins with the sample at 20 ms; its end, seen at 100 ms, lets go what waits.
    times = [time for time, _ in faulty["nodal_plane"]]
    late = (np.array(times) - stamps(faulty["nodal_plane"])) // MILLISECOND
    assert late.tolist() == [0] + [30] * 5 + [30, 20, 10] + [0] * 11
    assert stamps(faulty["nodal_plane"]) == periods(100)


def test_what_has_no_listener_is_left_out_but_counted():
    heard = set()
    telemetry = made(wanted=heard.__contains__)
    simulation = Simulation(Parameters())
    found = told(telemetry, periods(100, END // 2), simulation=simulation)
    assert set(found) == {*SENSORS, "contact_force"}
    heard |= {"trajectory", "waveform", "joint_states"}
    telemetry.origin = ORIGIN  # another place changes stamps and nothing else
    more = told(telemetry, periods(100)[10:], simulation=simulation)
    before = len(Simulation(Parameters()).advance_to(END // 2).segments)
    assert more["trajectory"][0][1]["sequence"] == before
    assert more["waveform"][0][1]["sequence"] == 5000
    assert stamps(more["waveform"])[0] == ORIGIN + END // 2
    assert stamps(more["joint_states"])[0] == ORIGIN + END // 2 + 10 * MILLISECOND
    assert len(more["joint_states"]) == 10
