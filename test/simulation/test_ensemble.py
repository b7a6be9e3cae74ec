"""Runs over initial vibration phases: those of a simulation, however many run together."""

import math
import subprocess
import sys
import threading

import numba
import numpy as np
import pytest
from drill_configurations import SANDSTONE
from silent_drill import plans_of
from support import exhaust

from rpud_sim.model import compile
from rpud_sim.model.compile import compilation_notice
from rpud_sim.model.engine import EngineError
from rpud_sim.simulation import ensemble, preset
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.ensemble import (
    Ensemble,
    Member,
    compile_kernels,
    run_ensemble,
    run_members,
)
from rpud_sim.simulation.metrics import METRICS, Metrics
from rpud_sim.simulation.simulation import Simulation

MILLISECOND = 1_000_000
PARAMETERS = preset("drilling")
DRILLING = Configuration(PARAMETERS)
RESONANCE = ActuatorParameters(actuator_model="resonance")
TRACKING = ActuatorParameters(actuator_model="resonance", generator="tracking", heating=True)


def test_means_and_standard_errors_are_those_of_the_members_that_have_a_figure():
    def found(*values):
        class Given(Metrics):
            def __init__(self, value):
                self.given = {"duration": 2.0} | dict.fromkeys(METRICS, value)

            def to_dict(self):
                return self.given

        ensemble = Ensemble(tuple(Member(Given(value)) for value in values), 1.0)
        assert ensemble.mean()["duration"] == 2.0
        return ensemble.mean()["events"], ensemble.standard_error()["events"]

    error = math.sqrt((4.0 + 1.0 + 9.0) / 2.0 / 3.0)
    assert found(1.0, 2.0, 6.0) == (3.0, pytest.approx(error))
    assert found(None, 2.0, 4.0) == (3.0, pytest.approx(1.0))
    assert found(None) == (None, None)
    assert repr(found(5)) == "(5, None)"  # and no float


# What runs in a drill, from the first command to a waveform; prints the kernels that it compiles.
AFTER_COMPILING = """
import sys
from rpud_sim.kernels.kernel import Kernel
from rpud_sim.simulation.changes import Change, Clear, Configure, Inject
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import Configuration, Settings
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run

def compiled():
    modules = [module for name, module in sys.modules.items() if name.startswith("rpud_sim.")]
    found = [item for module in modules for item in vars(module).values()]
    return {each: len(each.dispatcher.overloads) for each in found if isinstance(each, Kernel)}

compile_kernels(Configuration())
before = compiled()
assert sum(before.values()) > 0
commands = WeightOnBit(20.0), Drive(False, 0.0, 0.0), Drive(True, 50.0, 16100.0)
faults = Inject(Fault("free_mass_jammed"), 0), Clear()
regimes = Configure({"regime": "free"}), Configure({"regime": "drilling"})
actions = enumerate([*commands, *faults, *regimes], 6)
run = Run(Plan(Beginning(Settings()), [Change(n * 10_000_000, each) for n, each in actions]))
assert [*run.advance_to(200_000_000), *run.flush()]
print({each.__name__ for each, count in compiled().items() if count != before.get(each)})
"""


def test_nothing_is_left_to_compile_once_a_drill_runs():
    command = [sys.executable, "-c", AFTER_COMPILING]
    assert subprocess.run(command, stdout=subprocess.PIPE, check=True).stdout == b"set()\n"


@pytest.mark.parametrize(("limit", "reported"), [(0.01, True), (3600.0, False)])
def test_a_compilation_that_takes_long_is_reported(monkeypatch, limit, reported):
    told, lines = threading.Event(), []

    class Slow(Metrics):
        def add(self, block):
            assert numba.njit(lambda: 1)() == 1
            assert told.wait(10.0 if reported else 0.5) == reported

    compile_kernels(PARAMETERS)
    monkeypatch.setattr(ensemble, "Metrics", Slow)
    monkeypatch.setattr(compile, "_LONG", limit)
    compile_kernels(PARAMETERS, lambda line: (lines.append(line), told.set()))
    assert lines == [compilation_notice()] * reported


def exact(values):
    """Return values so that NaN equals NaN and -0.0 differs from 0.0."""
    return repr(values)


@pytest.mark.parametrize("actuator", [RESONANCE, ActuatorParameters()])
def test_members_are_runs_of_a_simulation(actuator):
    configuration, phases = Configuration(PARAMETERS, actuator), [0.25, 0.5, 0.75]
    found = run_members(plans_of(configuration, phases), 0.06)
    for phase, member in zip(phases, found, strict=True):
        metrics = Metrics()
        metrics.add(Simulation(configuration, phase).advance_to(60 * MILLISECOND))
        assert member.failure is None
        assert exact(member.metrics.to_dict()) == exact(metrics.to_dict())


@pytest.mark.parametrize("duration", [0.01, 11.0])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_failure_has_the_words_of_a_simulation(monkeypatch, duration, threads):
    exhaust(monkeypatch)
    drill = PARAMETERS.replace(free_mass=1e-6)
    with pytest.raises(EngineError, match="free_mass = 1e-06 kg") as expected:
        Simulation(drill, 0.25).advance_to(MILLISECOND)
    with pytest.raises(EngineError) as caught:
        run_ensemble(plans_of(drill, [0.25, 0.5, 0.75]), duration, threads=threads)
    members = run_members(plans_of(drill, [0.25, 0.5]), duration)
    failed = [str(member.failure) for member in members]
    assert len(failed) == 2
    assert str(caught.value) == failed[0] == str(expected.value)


@pytest.mark.parametrize(
    ("configuration", "duration"),
    [
        (DRILLING, 10.5),
        (Configuration(PARAMETERS, rock=SANDSTONE), 0.3),
        (Configuration(PARAMETERS, TRACKING), 0.1),
    ],
)
def test_threads_change_nothing(configuration, duration):
    phases = np.linspace(0.0, 0.9, 30 if duration < 1.0 else 3).tolist()
    reported = []
    plans = plans_of(configuration, phases)
    found = run_ensemble(plans, duration, reported.append, threads=3)
    assert sum(reported) == pytest.approx(duration * len(phases))

    def each(ensemble):
        return exact([member.metrics.to_dict() for member in ensemble.members])

    assert each(found) == each(run_ensemble(plans, duration))
