"""A drill that waits to be stepped: states, steps, resets, and the same bytes on every run."""

import pytest
from builtin_interfaces.msg import Time
from drill_client import (
    SECOND,
    TELEMETRY,
    contents,
    duration,
    nanoseconds,
    stamps,
)
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import Drive, Result, SimulationState, Status, WeightOnBit
from rpud_msgs.srv import (
    ClearFault,
    GetSimulationState,
    ResetSimulation,
    RunToTime,
    SetSimulationState,
    StepSimulation,
)

PARAMETERS = {"start_paused": True, "publish_clock": True}
RECORDED = (*TELEMETRY, "contact_force", "waveform", "trajectory")
Reset = ResetSimulation.Request


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill("/stepped", **PARAMETERS)


@pytest.fixture
def client(drill, connect):
    """At time zero, paused, with seed zero."""
    client = connect("/stepped")
    client.begin(seed=0)
    return client


def state_of(client):
    request = GetSimulationState.Request()
    return client.call(GetSimulationState, "simulation/get_state", request).state.state


def run_to(client, stamp):
    seconds, rest = divmod(stamp, SECOND)
    request = RunToTime.Request(time=Time(sec=seconds, nanosec=rest))
    return client.call(RunToTime, "simulation/run_to", request)


def try_step(client, seconds):
    request = StepSimulation.Request(duration=duration(seconds))
    return client.call(StepSimulation, "simulation/step", request)


def test_steps_add_up_to_the_nanosecond_and_all_that_happened_is_received(client):
    planes, impacts = map(client.listen_to_runs, ("nodal_plane", "contact_force"))

    def heard():
        client.reset()
        client.step(0.01)
        return planes[-1] and impacts[-1]

    client.until(heard)
    client.reset()
    assert client.step(0.25) == SECOND // 4
    assert client.step(0.001234567) == SECOND // 4 + 1_234_567
    reached = run_to(client, SECOND)
    assert reached.result.result == Result.RESULT_OK
    assert nanoseconds(reached.time) == SECOND
    client.until(lambda: len(planes[-1]) >= 100)
    assert stamps(planes[-1]) == [number * SECOND // 100 for number in range(1, 101)]
    last = client.until(lambda: next((s for s in client.status if stamps([s]) == [SECOND]), None))
    assert last.state == Status.STATE_PAUSED
    client.until(lambda: len(impacts[-1]) >= last.impacts - 1)
    sequences = [message.sequence for message in impacts[-1]]
    assert sequences == list(range(len(sequences)))
    assert state_of(client) == SimulationState.STATE_PAUSED


@pytest.mark.parametrize(
    "durability", [DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL]
)
def test_at_a_standstill_the_clock_is_still_published(client, durability):
    client.reset()
    reached = client.step(0.25)
    clock = client.listen("/clock", QoSProfile(depth=100, durability=durability))
    client.until(lambda: len(clock) >= 5)
    assert {nanoseconds(message.clock) for message in clock} == {reached}


def test_it_plays_pauses_and_stops_with_the_results_of_the_standard(client):
    playing, paused, stopped = (
        SimulationState.STATE_PLAYING,
        SimulationState.STATE_PAUSED,
        SimulationState.STATE_STOPPED,
    )
    already = SetSimulationState.Response.ALREADY_IN_TARGET_STATE
    assert client.set_state(paused).result == already
    assert client.set_state(playing).result == Result.RESULT_OK
    assert client.set_state(playing).result == already
    assert state_of(client) == playing
    for refused in (try_step(client, 0.01), run_to(client, 1000 * SECOND)):
        assert refused.result.result == Result.RESULT_OPERATION_FAILED
        assert refused.result.error_message == "it is playing, not paused"
    clock = client.listen("/clock")
    client.until(lambda: len(clock) > 10)
    assert client.set_state(stopped).result == Result.RESULT_OK
    assert client.set_state(stopped).result == already
    assert try_step(client, 0.01).result.error_message == "it is stopped, not paused"
    client.until(lambda: client.status[-1].state == Status.STATE_STOPPED)
    assert stamps(client.status[-1:])[0] == 0
    assert client.set_state(paused).result == Result.RESULT_OK
    assert client.step(0.02) == SECOND // 50
    unknown = client.set_state(9)
    assert unknown.result == Result.RESULT_FEATURE_UNSUPPORTED
    assert unknown.error_message == "state 9 is unknown"


def test_a_reset_of_the_state_lets_stamps_go_on(client):
    client.command(WeightOnBit(force=20.0))
    client.until(lambda: client.status[-1].weight_on_bit == 20.0)
    client.step(0.3)
    assert client.inject("lost_preload").success
    assert client.reset(Reset.SCOPE_STATE).result == Result.RESULT_OK
    client.until(lambda: client.status[-1].weight_on_bit == 8.0)
    last = client.status[-1]
    assert (last.active_faults, last.commands_accepted) == (0, 0)
    assert last.impacts <= 1  # at time zero all gaps are closed
    assert stamps([last]) == [3 * SECOND // 10]
    assert client.step(0.1) == 4 * SECOND // 10


def test_a_reset_of_the_time_leaves_the_state(client):
    client.step(0.3)
    client.until(lambda: stamps(client.status[-1:])[0] == 3 * SECOND // 10)
    impacts = client.status[-1].impacts
    assert impacts > 0
    assert client.inject("lost_preload").success
    assert client.reset(Reset.SCOPE_TIME).result == Result.RESULT_OK
    client.until(lambda: stamps(client.status[-1:])[0] == 0)
    assert (client.status[-1].impacts, client.status[-1].active_faults) == (impacts, 1)
    assert client.step(0.1) == SECOND // 10
    assert client.reset(Reset.SCOPE_SPAWNED).result == Result.RESULT_OK
    client.until(lambda: client.status[-1].active_faults == 0)
    assert stamps(client.status[-1:])[0] == SECOND // 10
    assert client.status[-1].impacts > impacts


def script(client):
    """Drill for a second, with commands and faults in between; give the stamp at its end."""
    client.step(0.3)
    accepted = client.status[-1].commands_accepted
    client.command(WeightOnBit(force=25.0))
    client.command(Drive(enabled=True, voltage=90.0, frequency=16100.0))
    client.until(lambda: client.status[-1].commands_accepted == accepted + 2)
    client.step(0.2)
    assert client.inject("restitution_loss", magnitude=0.9, seconds=0.123456789).success
    assert client.inject("noise", "reacting_force", 2.0).success
    assert client.inject("intermittent", "contact_force", 0.5).success
    client.step(0.3003)
    cleared = client.call(ClearFault, "clear_fault", ClearFault.Request(number=0))
    assert cleared.success
    return client.step(0.2)


class Tape:
    """All that goes out, bit by bit."""

    def __init__(self, client):
        self._client = client
        self._runs = {topic: client.listen_to_runs(topic) for topic in RECORDED}
        self._faults = client.listen("faults")
        # Whether the other side knows of all listeners shows in what they hear.
        client.until(lambda: client.step(0.1) and all(map(any, self._runs.values())))
        self._count = 1

    def record(self, seed):
        """Give the contents of all messages of a run from a reset on, and the ground truth."""
        self._client.begin(seed)
        script(self._client)
        self._client.until(
            lambda: [fault.active for fault in self._faults[-1].faults] == [False] * 3
        )
        faults = contents(self._faults[-1])
        # All of this run has arrived on a topic when something of the next run has.
        self._client.begin()
        self._client.step(0.1)
        self._count += 2
        self._client.until(lambda: all(len(it) == self._count for it in self._runs.values()))
        recorded = {topic: list(map(contents, runs[-2])) for topic, runs in self._runs.items()}
        return {**recorded, "faults": faults}


def test_the_same_seed_gives_the_same_bytes_and_another_one_does_not(client, start_drill, connect):
    tape = Tape(client)
    first, again, other = tape.record(7), tape.record(7), tape.record(8)
    for topic, recorded in first.items():
        assert recorded
        assert recorded == again[topic], topic
    for topic in ("nodal_plane", "contact_force", "trajectory", "reacting_force"):
        assert first[topic] != other[topic], topic
    # A drill that is started with the seed begins as one that is reset to it.
    start_drill("/seeded", seed=7, **PARAMETERS)
    assert Tape(connect("/seeded")).record(None) == first


def test_a_signal_ends_a_step_and_its_client_gets_an_answer(start_drill, connect):
    process = start_drill("/ended", **PARAMETERS)
    client = connect("/ended")
    request = StepSimulation.Request(duration=duration(1e6))
    step = client.call_async(StepSimulation, "simulation/step", request)
    client.until(lambda: client.status and client.status[-1].state == Status.STATE_RUNNING)
    process.terminate()
    client.until(step.done)
    assert step.result().result.error_message == "interrupted: the drill has stopped"
    assert process.wait() == 0
    assert "Traceback" not in process.output
