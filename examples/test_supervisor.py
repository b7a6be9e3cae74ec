"""Tests the supervisor against its requirements: in steps, and the same to the last bit every time.

To test other mission software, copy this file and ``requirements.yaml``, and start that instead.
"""

from pathlib import Path

import pytest

from rpud_sim.verdicts import read_expectations

FOLDER = Path(__file__).parent
REQUIREMENTS = {each.requirement: each for each in read_expectations(FOLDER / "requirements.yaml")}
IN_EVERY_FLIGHT = ("REQ-01", "REQ-02", "REQ-03", "REQ-05", "REQ-08")
ANSWERS = ("command/drive", "command/weight_on_bit")

# The drill in the rock begins outside it and at rest: the supervisor does the rest.
pytestmark = pytest.mark.rpud(
    config="../config/drilling.yaml",
    regime="free",
    drive_enabled=False,
    weight_on_bit=0.0,
    command_timeout=0.5,
)


@pytest.fixture
def supervisor():
    """The program under test."""
    return FOLDER / "supervisor.py"


def start(drill, supervisor):
    """Start the supervisor; each step is over when it has commanded."""
    drill.with_answers(*ANSWERS)
    command = ("python", str(supervisor), "--ros-args", "-r", f"__ns:={drill.namespace}")
    known = {"subscribes_to": ("wrench",), "ready": "the drill is there"}
    return drill.start(*command, **known, keep="supervisor/leave")


def expect(drill, *identifiers):
    """Check what holds in every run, and further requirements."""
    drill.expect(*(REQUIREMENTS[each] for each in (*IN_EVERY_FLIGHT, *identifiers)))


@pytest.fixture(scope="module")
def runs():
    """Reacting forces of the runs with a jam, by supervisor."""
    return {}


@pytest.mark.parametrize("time", ["once", "again"])
def test_it_drills_at_its_target_and_retreats_from_a_jam(drill, supervisor, runs, time):
    start(drill, supervisor)
    drill.step(5.0)
    drill.inject("free_mass_jammed")
    drill.step(1.0)
    expect(drill, "REQ-04", "REQ-06", "REQ-07")
    forces = [message.force for message in drill.messages("reacting_force")]
    assert forces == runs.setdefault(supervisor, forces)  # again, to the last bit


def test_it_goes_on_with_noise_lost_messages_and_a_lost_preload(drill, supervisor):
    start(drill, supervisor)
    drill.step(1.0)
    drill.inject("lost_preload")
    drill.inject("intermittent", "contact_force")
    drill.inject("intermittent", "reacting_force")
    drill.inject("noise", "reacting_force", 10.0)
    drill.step(2.0)
    expect(drill, "REQ-09")


@pytest.mark.parametrize(
    ("kind", "magnitude"), [("stuck", None), ("delayed", 0.15), ("garbage", None)]
)
def test_it_retreats_without_a_force_sensor_to_trust(drill, supervisor, kind, magnitude):
    start(drill, supervisor)
    drill.step(1.0)
    drill.inject(kind, "reacting_force", magnitude)
    drill.step(1.0)
    expect(drill, "REQ-10")


def test_when_it_dies_the_drill_makes_itself_safe(drill, supervisor):
    process = start(drill, supervisor)
    drill.step(1.0)
    process.kill()
    drill.step(1.0)
    assert drill.status.commands_lost
    assert drill.status.weight_on_bit == 0.0
    assert not drill.status.drive_enabled
