"""A drill that follows the /clock of another node."""

import pytest
from drill_client import SECOND, nanoseconds, stamps, steps
from rcl_interfaces.srv import GetParameters
from rosgraph_msgs.msg import Clock
from rpud_msgs.msg import Result, SimulationState, Status

TICK = SECOND // 50
BEGIN = 5000 * SECOND


class Source:
    """Another simulation, whose time goes on as the test wants."""

    def __init__(self, client):
        self._client = client
        self._publisher = client.node.create_publisher(Clock, "/clock", 1000)
        self.now = BEGIN

    def connect(self):
        self._client.until(self._publisher.get_subscription_count)

    def run(self, length):
        """Go on, or back, at once or tick by tick, and leave nothing out."""
        for _ in range(max(1, length // TICK)):
            self.now += min(length, TICK)
            self._send()

    def until(self, condition):
        """Stand still until a condition holds: a clock is best effort, so its last may be lost."""
        self._client.until(lambda: self._send() or condition())

    def _send(self):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(self.now, SECOND)
        self._publisher.publish(message)


@pytest.fixture
def client(connect):
    return connect("/following")


@pytest.fixture
def source(client):
    return Source(client)


@pytest.fixture
def drill(start_drill):
    # Its own factor has no meaning: the time is not its own.
    parameters = {"use_sim_time": True, "real_time_factor": 0.0, "seed": 3}
    return start_drill("/following", "waiting for /clock, as use_sim_time is set", **parameters)


def test_it_goes_and_stands_with_the_clock_and_restarts_when_that_goes_back(drill, client, source):
    planes, impacts, timings = map(client.listen, ("nodal_plane", "contact_force", "timing"))
    statuses = client.status
    # It answers while it waits.
    names = GetParameters.Request(names=["seed"])
    assert client.call(GetParameters, "/following/drill_node/get_parameters", names).values
    assert client.inject("bias", "reacting_force", 1.0).success
    source.connect()
    source.run(TICK)
    source.until(lambda: statuses[-1].state == Status.STATE_RUNNING)
    zero = nanoseconds(statuses[-1].drive_applied)
    assert zero == source.now
    source.run(SECOND)
    source.until(lambda: planes and stamps(planes[-1:])[0] == source.now)
    assert all(zero <= stamp <= source.now for stamp in stamps(impacts))

    # The clock stands still, and so does the drill: but its status still comes.
    count, heard = len(planes), len(statuses)
    client.until(lambda: len(statuses) >= heard + 2)
    assert (len(planes), timings[-1].lag) == (count, 0.0)
    for refused in (client.set_state(SimulationState.STATE_PAUSED), client.reset()):
        assert refused.result == Result.RESULT_FEATURE_UNSUPPORTED
        assert refused.error_message.startswith("the time comes from /clock")

    # It goes on where it stood, and restarts when the clock goes back.
    source.run(SECOND // 2)
    source.until(lambda: stamps(planes[-1:])[0] == source.now)
    assert set(steps(stamps(planes))) == {SECOND // 100}
    assert set(steps([message.sequence for message in impacts])) == {1}
    assert statuses[-1].active_faults == 1
    source.run(-SECOND)
    source.until(lambda: "/clock went back: the drill restarts" in drill.output)
    source.until(lambda: statuses[-1].active_faults == 0)
    back = len(planes)
    assert stamps(statuses[-1:])[0] == source.now
    source.run(SECOND // 2)
    source.until(lambda: len(planes) > back and stamps(planes[-1:])[0] == source.now)
    assert stamps(planes)[back] == source.now - SECOND // 2 + SECOND // 100

    # A year ahead is another time, not a year of drilling; and a time before 1970 is none.
    source.now += 365 * 86_400 * SECOND
    source.until(lambda: "/clock jumped 31536000 s ahead: the drill restarts" in drill.output)
    source.until(lambda: stamps(statuses[-1:])[0] == source.now)
    source.run(SECOND // 2)
    source.until(lambda: stamps(planes[-1:])[0] == source.now)
    source.now = -5 * SECOND
    source.until(lambda: "/clock = -5 s is outside its range [0, 2147483647] s" in drill.output)

    # Whose time it is must be clear.
    client.node.create_publisher(Clock, "/clock", 1)
    client.until(lambda: "/clock has 2 publishers, " in drill.output)


@pytest.mark.extended
def test_a_signal_ends_it_while_it_waits(drill):
    drill.terminate()
    assert drill.wait() == 0
    assert "Traceback" not in drill.output


def test_a_time_whose_stamps_no_message_can_hold_is_left_out(drill, client, source):
    statuses = client.status
    source.connect()
    source.run(TICK)
    source.until(lambda: statuses[-1].state == Status.STATE_RUNNING)
    source.now, before = (2**31 - 1) * SECOND, source.now
    source.until(lambda: "/clock = 2147483647 s is left out" in drill.output)
    source.now = before
    source.run(SECOND)
    count = len(statuses)
    source.until(lambda: len(statuses) > count + 2)
    assert BEGIN <= stamps(statuses[-1:])[0] <= source.now
