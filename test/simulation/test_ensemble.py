"""Runs over initial vibration phases: reproducible, with a standard error."""

import math
import subprocess
import sys
import threading

import numba
import pytest

from rpud_sim.drilling.rock import RockParameters
from rpud_sim.model import compile
from rpud_sim.model.compile import compilation_notice
from rpud_sim.simulation import ensemble, preset
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.ensemble import Ensemble, compile_kernels, run_ensemble
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.scenario import Scenario, ScheduledFault
from rpud_sim.simulation.simulation import Simulation, initial_phases
from rpud_sim.simulation.statistics import FIGURES, Statistics

SANDSTONE = RockParameters(rock_model="specific_energy")
PARAMETERS = preset("drilling")


def test_a_single_run_without_a_seed_begins_at_phase_zero():
    assert initial_phases(1, None) == (0.0,)


def test_phases_are_those_of_the_seed():
    assert initial_phases(5, 7) == initial_phases(5, 7)
    assert initial_phases(5, 7) != initial_phases(5, 8)
    assert initial_phases(5, None) == initial_phases(5, 0)
    assert initial_phases(5, 7)[:3] == initial_phases(3, 7)
    assert initial_phases(1, 7) != (0.0,)
    assert all(0.0 <= phase < 1.0 for phase in initial_phases(1000, 1))


def test_a_member_is_the_run_of_its_phase():
    simulation, statistics = Simulation(PARAMETERS, 0.25), Statistics()
    statistics.add(simulation.advance_to(500_000_000))
    assert run_ensemble(PARAMETERS, 0.5, [0.25]).members == (statistics.figures(),)


def test_a_long_run_is_made_in_strides_and_reported():
    reported = []
    ensemble = run_ensemble(PARAMETERS, 25.0, [0.0], reported.append)
    assert reported == [10.0, 10.0, 5.0]
    assert ensemble.members[0]["duration"] == 25.0
    assert ensemble.real_time_factor > 1.0


def test_a_rock_has_depth_and_rate_among_the_figures():
    configuration = Configuration(PARAMETERS, rock=SANDSTONE)
    [found] = run_ensemble(configuration, 0.5, [0.25]).members
    simulation = Simulation(configuration, 0.25)
    simulation.advance_to(500_000_000)
    assert found["depth"] == simulation.depth > 0.0
    assert found["penetration_rate"] == simulation.depth / 0.5
    ensemble = run_ensemble(configuration, 0.5, [0.25, 0.5])
    assert {"depth", "penetration_rate"} <= ensemble.mean().keys()
    assert {"depth", "penetration_rate"} <= ensemble.standard_error().keys()
    assert "depth" not in run_ensemble(PARAMETERS, 0.1, [0.25]).mean()


def test_every_member_has_the_scenario_s_faults():
    scenario = Scenario(0, (ScheduledFault(0, None, Fault("free_mass_jammed")),))
    ensemble = run_ensemble(PARAMETERS, 1.0, [0.25, 0.5], scenario=scenario)
    assert all(member["drill_tool_impact_rate"] <= 2.0 for member in ensemble.members)


def member(value):
    return {"duration": 2.0} | dict.fromkeys(FIGURES, value)


def test_means_and_standard_errors_are_those_of_the_members():
    ensemble = Ensemble((0.1, 0.2, 0.3), (member(1.0), member(2.0), member(6.0)), (), 1.0)
    assert ensemble.mean() == {"duration": 2.0} | dict.fromkeys(FIGURES, 3.0)
    expected = math.sqrt((4.0 + 1.0 + 9.0) / 2.0 / 3.0)
    assert ensemble.standard_error() == pytest.approx(dict.fromkeys(FIGURES, expected))


def test_members_without_a_figure_are_left_out_of_its_mean():
    ensemble = Ensemble((0.1, 0.2, 0.3), (member(None), member(2.0), member(4.0)), (), 1.0)
    assert ensemble.mean()["contact_force_mean"] == 3.0
    assert ensemble.standard_error()["contact_force_mean"] == pytest.approx(1.0)
    empty = Ensemble((0.1,), (member(None),), (), 1.0)
    assert empty.mean()["contact_force_mean"] is None


def test_one_member_has_its_own_figures_and_no_error():
    ensemble = Ensemble((0.1,), (member(5),), (), 1.0)
    assert ensemble.mean()["events"] == 5
    assert type(ensemble.mean()["events"]) is int
    assert ensemble.standard_error() == dict.fromkeys(FIGURES)


# What runs in a drill, from the first command to a waveform; prints the kernels that it compiles.
AFTER_COMPILING = """
import dataclasses, sys
from numba.core.dispatcher import Dispatcher
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import Configuration, Settings
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.run import Beginning, Run

MILLISECOND = 1_000_000

def compiled():
    return {
        f"{item.__module__}.{item.__name__}": len(item.overloads)
        for name, module in list(sys.modules.items()) if name.startswith("rpud_sim.")
        for item in vars(module).values() if isinstance(item, Dispatcher)
    }

compile_kernels(Configuration())
before = compiled()
assert sum(before.values()) > 0
run = Run(Beginning(Settings()))
simulation = run.simulation

def on(*changes):
    for change in changes:
        change()
    list(run.advance_to(run.time + 10 * MILLISECOND))

def to(**values):
    parameters = dataclasses.replace(simulation.configuration.parameters, **values)
    simulation.configure(dataclasses.replace(simulation.configuration, parameters=parameters))

for _ in range(6):
    on()
on(lambda: simulation.apply(WeightOnBit(20.0)), lambda: simulation.apply(Drive(False, 0.0, 0.0)))
on(lambda: simulation.apply(Drive(True, 50.0, 16100.0)))
on(lambda: simulation.inject(Fault("free_mass_jammed"), 0))
on(simulation.clear_all)
on(lambda: to(regime="free"))
on(lambda: to(regime="drilling"))
list(run.flush())
print({name for name, count in compiled().items() if count != before.get(name)})
"""


def test_nothing_is_left_to_compile_once_a_drill_runs():
    run = subprocess.run(
        [sys.executable, "-c", AFTER_COMPILING], stdout=subprocess.PIPE, text=True, check=True
    )
    assert run.stdout == "set()\n"


@pytest.mark.parametrize("long", [True, False])
def test_a_compilation_that_takes_long_is_reported(monkeypatch, long):
    told = threading.Event()

    class Compiling(Statistics):
        def add(self, block):
            assert numba.njit(lambda: 1)() == 1
            assert told.wait(10.0)

    def tell(line):
        lines.append(line)
        told.set()

    lines = []
    if not long:
        told.set()
    monkeypatch.setattr(ensemble, "Statistics", Compiling)
    monkeypatch.setattr(compile, "_LONG", 0.01 if long else 3600.0)
    compile_kernels(PARAMETERS, tell)
    assert lines == [compilation_notice()] * long


def test_cached_kernels_are_not_reported_however_busy_the_machine_is(monkeypatch):
    told = threading.Event()

    class Slow(Statistics):
        def add(self, block):
            told.wait(0.5)  # longer than the notice needs

    compile_kernels(PARAMETERS)
    monkeypatch.setattr(ensemble, "Statistics", Slow)
    monkeypatch.setattr(compile, "_LONG", 0.0)
    compile_kernels(PARAMETERS, lambda line: told.set())
    assert not told.is_set()
