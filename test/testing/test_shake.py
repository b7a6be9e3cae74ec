"""Shaken runs: what disturbs them, how they are compared, and what pytest reports."""

import signal
import subprocess
import sys

import pytest
from rclpy.serialization import serialize_message
from rpud_msgs.msg import WeightOnBit

from rpud_sim.testing.attempt_records import (
    Difference,
    DrillRecord,
    Heard,
    HeardMessages,
    first_difference,
    verdict_differences,
)
from rpud_sim.testing.disturbances import Disturbances, DisturbedStep, Stop
from rpud_sim.testing.shake import circumstances
from rpud_sim.verdicts import Verdict

pytest_plugins = ["pytester"]

PERIOD = 100_000_000  # ns
WEIGHT = "command/weight_on_bit"
# Its command depends on whether contact_force or reacting_force arrives first.
RACER = """
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rpud_msgs.msg import ContactForce, ReactingForce, WeightOnBit

class Racer(Node):
    def __init__(self):
        super().__init__("racer", namespace="/rpud")
        self.peak = 0.0
        self.command = self.create_publisher(WeightOnBit, "command/weight_on_bit", 10)
        self.create_subscription(ContactForce, "contact_force", self.strike, 1)
        self.create_subscription(ReactingForce, "reacting_force", self.answer, 1000)

    def strike(self, message):
        self.peak = message.peak_force

    def answer(self, message):
        if message.header.stamp.nanosec % 100_000_000 == 0:
            self.command.publish(WeightOnBit(header=message.header, force=5.0 + self.peak / 1e3))

rclpy.init()
try:
    rclpy.spin(Racer())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""


class System:
    """Process under test that keeps the signals which disturb it."""

    running, paused = True, False

    def __init__(self, name="mission.py"):
        self.name, self.signals = name, []

    def disturb(self, number):
        self.signals.append(number)


def drawn(seed, systems, count=40):
    disturbances = Disturbances(seed)
    for number in range(count):
        step = disturbances._drawn((number + 1) * PERIOD, [system.name for system in systems])
        disturbances.steps.append(step)
    return disturbances.steps


def test_the_same_seed_draws_the_same_disturbances():
    systems = [System(), System("watch.py")]
    steps = drawn("1", systems)
    assert steps == drawn("1", systems) != drawn("2", systems)
    stops = [stop for step in steps for stop in step.stops]
    assert {stop.name for stop in stops} == {"mission.py", "watch.py"}
    assert all(1 <= stop.length <= 60 for stop in stops)
    assert {bool(stop.delay) for stop in stops} == {True, False}
    assert {bool(step.shuffle) for step in steps} == {True, False}


def test_every_stopped_process_goes_on_also_after_an_error_and_a_pause_of_the_test_stays():
    system, paused = System(), System("paused.py")
    paused.paused = True
    disturbances = Disturbances("1")
    for number in range(6):
        with pytest.raises(ZeroDivisionError), disturbances.step(number * PERIOD, [system, paused]):
            raise ZeroDivisionError
        assert system.signals[-1:] in ([], [signal.SIGCONT])
    assert signal.SIGSTOP in system.signals
    assert paused.signals == []


def weights(*forces, begin=1):
    """Return commands, one in each period; None for a missing one."""
    messages = []
    for number, force in enumerate(forces, begin):
        if force is not None:
            message = WeightOnBit(force=force)
            message.header.stamp.nanosec = number * PERIOD
            messages.append((serialize_message(message), number * PERIOD))
    payloads, stamps = zip(*messages, strict=True)
    return HeardMessages(WeightOnBit, True, payloads, stamps)


def record(heard, entries=(), verdicts=(), steps=()):
    topics = {WEIGHT: heard} if isinstance(heard, HeardMessages) else heard
    return DrillRecord((Heard(topics, entries),), verdicts, steps, ("contact_force", "wrench"), 100)


@pytest.mark.parametrize(
    ("there", "text"),
    [
        (weights(1.0, 2.5, 4.0), "0.200 s: force is 2.5 there, 2 in the first run"),
        (weights(1.0, 2.0 + 1e-12, 3.0), "0.200 s: force is 2.000000000001 there, 2.0 in the"),
        (weights(1.0, None, 3.0), "0.200 s: no message, in the first run one"),
        (weights(1.0, 2.0), "0.300 s: no more message, in the first run 1 more message"),
        (weights(1.0, 2.0, 3.0, 4.0), "0.400 s: 1 more message, in the first run no more"),
        (weights(1.0, 2.0, 3.0, begin=5), "0.100 s: header.stamp is 0.500000000 s there, 0.1"),
    ],
)
def test_the_first_message_that_differs_is_named_with_its_fields(there, text):
    first = record(weights(1.0, 2.0, 3.0))
    assert first_difference(first, first) is None
    assert str(first_difference(first, record(there))).startswith(f"{WEIGHT} at {text}")


def test_the_earliest_stamp_counts_then_the_topic():
    first = record({"b": weights(1.0, 2.0), "a": weights(1.0, 2.0, 3.0)})
    there = record({"b": weights(1.0, 2.5), "a": weights(1.0, 2.0, 3.5)})
    assert first_difference(first, there)[1:3] == (2 * PERIOD, "b")
    there = record({"b": weights(1.0, 2.5), "a": weights(1.0, 2.5, 3.0)})
    assert first_difference(first, there)[1:3] == (2 * PERIOD, "a")


def test_a_command_that_took_effect_later_is_a_difference():
    heard = weights(1.0)
    first, there = (
        record(heard, ((time, "weight_on_bit force 1.0"),)) for time in (PERIOD, 2 * PERIOD)
    )
    text = "what the drill did at 0.100 s: nothing, in the first run weight_on_bit force 1.0"
    assert str(first_difference(first, there)) == text


def test_outcomes_and_margins_of_verdicts_are_compared():
    first = (Verdict("calm", "R1", "passed", 0.5, "N"), Verdict("late", "", "passed"))
    there = (Verdict("calm", "R1", "passed", 0.25, "N"), Verdict("late", "", "failed"))
    assert verdict_differences(first, first) == []
    assert verdict_differences(first, there) == [
        "verdict calm: passed, margin 0.25 N, in the first run passed, margin 0.5 N",
        "verdict late: failed, in the first run passed",
    ]


def test_a_difference_comes_with_what_disturbed_its_step_or_the_latest_one_before():
    stop = Stop("mission.py", 4, 31)
    steps = [
        DisturbedStep(PERIOD, 0, (stop,)),
        DisturbedStep(2 * PERIOD, 0, ()),
        DisturbedStep(3 * PERIOD, 5, ()),
    ]
    there = record(weights(1.0, 2.5, 3.5), steps=tuple(steps))

    def told(*forces):
        return circumstances(there, first_difference(record(weights(*forces)), there))

    stopped = "in the step to 0.100 s mission.py was stopped for 31 ms, 4 ms after it began"
    assert told(1.5, 2.0, 3.0) == [stopped]
    assert told(1.0, 2.0, 3.0) == [f"the latest disturbance was {stopped}"]
    [line] = told(1.0, 2.5, 3.0)
    assert line.startswith("in the step to 0.300 s the drill published ")
    assert "contact_force" in line
    assert circumstances(record(weights(1.0)), Difference(0, PERIOD, WEIGHT, "")) == [
        "no node was disturbed before: it differs by itself"
    ]


@pytest.mark.extended
def test_a_race_is_found_and_a_test_with_it_fails_once(pytester, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")  # of the summary
    pytester.makefile(".py", racer=RACER)
    pytester.makepyfile("""
        import pytest

        @pytest.fixture(scope="module")
        def attempts():
            found = {"race": 0, "alone": 0, "unlucky": 0}
            yield found
            print(f"at the end {found}")

        def test_race(drill, attempts):
            attempts["race"] += 1
            drill.with_answers("command/weight_on_bit")
            drill.start("python racer.py", subscribes_to=("reacting_force", "contact_force"))
            drill.step(1.0)
            assert drill.status.impacts

        def test_alone(attempts):
            attempts["alone"] += 1

        def test_unlucky(drill, attempts):
            attempts["unlucky"] += 1
            drill.step(0.1)
            assert drill.status.impacts
            assert attempts["unlucky"] != 3

        def test_fails(drill, attempts):
            drill.step(0.1)
            assert attempts["alone"] == 1
            assert not drill.time

        def test_count(attempts):
            assert attempts["alone"] == 1
            assert attempts["unlucky"] == 3
    """)
    options = ("-p", "no:cacheprovider", "-rA", "--rpud-shake=4", "--rpud-shake-seed=3")
    result = pytester.runpytest_subprocess(*options)
    result.assert_outcomes(passed=2, failed=3)
    result.stdout.fnmatch_lines(
        [
            "rpud_sim: 4 shaken runs of each test with a drill, seed 3",
            "shaken run * of 4 (seed 3): the first difference is command/weight_on_bit at *"
            " s: force is * there, * in the first run",
            "*in the step to * s *",
            "to repeat it: --rpud-shake 4 --rpud-shake-seed 3",
            "artefacts: *",
            "E *assert 3 != 3",
            "shaken run 2 of 4 (seed 3): the test failed only here",
            "FAILED *::test_unlucky - shaken run 2 of 4 (seed 3): the test failed only here*",
        ]
    )
    # The plan of the attempt is that of its seed.
    [file] = (pytester.path / "rpud-artefacts").glob("*test_race/disturbances.txt")
    lines = file.read_text().splitlines()
    number = int(result.stdout.str().partition("shaken run ")[2][0])
    [test] = {
        line.split()[1] for line in result.outlines if "FAILED" in line and "::test_race" in line
    }
    plan = drawn(f"3 {test} {number} 1", [System("racer.py")], 10)
    assert lines == list(map(str, plan))


@pytest.mark.extended
def test_the_supervisor_of_the_examples_is_not_accused(request):
    root = request.config.rootpath
    command = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rpud-artefacts=")
    chosen = ("examples/test_supervisor.py", "-k", "goes_on_with_noise", "--rpud-shake=3")
    done = subprocess.run([*command, *chosen], cwd=root, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
