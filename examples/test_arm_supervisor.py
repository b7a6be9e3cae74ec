"""Tests the supervisor of a drill on an arm against its requirements, and the requirements."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from rpud_sim.testing.errors import ExpectationFailedError
from rpud_sim.verdicts import read_expectations

FOLDER = Path(__file__).parent
SUPERVISOR = FOLDER / "arm_supervisor.py"
EXPECTATIONS = read_expectations(FOLDER / "requirements_arm.yaml")
REQUIREMENTS = {each.requirement: each for each in EXPECTATIONS}
ANSWERS = ("command/feed", "command/drive")
HEARD = ("wrench", "rotation", "mount", "borehole")
PERIOD = 0.05  # of the supervisor [s]

pytestmark = pytest.mark.rpud(config="../config/arm.yaml")


def start(drill, supervisor=SUPERVISOR, **parameters):
    """Start the supervisor; each step is over when it has commanded."""
    drill.with_answers(*ANSWERS, period=PERIOD)
    words = [f"-p {name}:={value}" for name, value in parameters.items()]
    command = f"python {supervisor} --ros-args -r __ns:={drill.namespace} {' '.join(words)}"
    drill.start(command, subscribes_to=HEARD, ready="the drill is there")


@pytest.mark.extended
@pytest.mark.timeout(300)
def test_it_drills_three_strata_and_clears_choking_and_an_inclusion(drill):
    drill.listen("supervisor/state", "diagnostic_msgs/msg/DiagnosticArray")
    start(drill)
    drill.step(10.0)
    drill.inject("choking", magnitude=0.9, duration=3.0)
    drill.step_until(lambda: drill.latest("borehole").depth >= 0.05, timeout=40.0)
    drill.step(4.0)
    drill.expect(*EXPECTATIONS)
    layers = dict.fromkeys(message.layer for message in drill.messages("borehole"))
    assert [*layers] == ["regolith", "chalk", "inclusion", "weak sandstone"]
    said = drill.messages("supervisor/state")
    states = [message.status[0].name for message in said]
    assert states.count("clearing") >= 2  # the choked hole, the inclusion, and what packs later
    assert states[-1] == "done"


@pytest.fixture(scope="module")
def gains():
    specification = importlib.util.spec_from_file_location("arm_supervisor", SUPERVISOR)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    assert module.PERIOD == PERIOD * 1e9
    return module.GAIN, module.RESET


@pytest.mark.parametrize("stiffness", [1e3, 2e4, np.inf])
def test_the_theory_says_that_its_force_control_is_stable(gains, stiffness):
    gain, reset = gains
    spring = 2000.0
    series = spring / (1.0 + spring / stiffness) * PERIOD  # N per m/s and period
    # W' = W + series (gain e + i), i' = i + reset PERIOD e, e of the period before: a delay of one.
    loop = np.array([[1.0, -series * gain, series], [1.0, 0.0, 0.0], [0.0, -reset * PERIOD, 1.0]])
    eigenvalues = np.linalg.eigvals(loop)
    assert np.abs(eigenvalues).max() < 0.95
    doubled = np.array(loop)
    doubled[0, 1] *= 2.0
    assert np.abs(np.linalg.eigvals(doubled)).max() < 1.0  # gain margin


# What is wrong, which text of the supervisor it replaces, the new text, and who catches it.
MUTANTS = {
    "presses too hard": ("self._press(self._weight)", "self._press(2 * self._weight)", "ARM-02"),
    "starts with a blow": ("START_WEIGHT = 8.0", "START_WEIGHT = 20.0", "ARM-03"),
    "turns without drawing back": (
        'if self._latest["mount"].position > 0.0:',
        "if False:",
        "ARM-05",
    ),
    "commands the feed too fast": ("TRAVEL = 0.04", "TRAVEL = 0.08", "ARM-10"),
}


@pytest.mark.extended
@pytest.mark.parametrize("name", MUTANTS)
@pytest.mark.timeout(300)
def test_a_broken_supervisor_is_caught(drill, tmp_path, name):
    old, new, requirement = MUTANTS[name]
    source = SUPERVISOR.read_text()
    assert source.count(old) == 1
    mutant = tmp_path / "mutant.py"
    mutant.write_text(source.replace(old, new))
    start(drill, mutant, depth=0.004 if requirement == "ARM-10" else 0.05)
    drill.step(5.0)
    if requirement == "ARM-05":
        drill.inject("choking", magnitude=0.9, duration=3.0)
        drill.step(6.0)
    expectation = REQUIREMENTS[requirement]
    with pytest.raises(ExpectationFailedError) as caught:
        drill.expect(expectation)
    assert [each.outcome for each in caught.value.verdicts] == ["failed"]
