"""Simulation of the drill without ROS, for scripts.

A ``Plan`` is the beginning of a run and its changes. A ``Run`` carries it out: ``apply`` takes
changes, ``advance_to`` yields the messages that the drill node publishes. ``run_ensemble`` computes
the metrics of whole runs. Times are integer nanoseconds of simulation time, other values are in SI
units::

    from rpud_sim.simulation import Beginning, Plan, Run, Settings, WeightOnBit

    run = Run(Plan(Beginning(Settings())))
    run.apply(WeightOnBit(20.0))
    found = {}
    for batch in run.advance_to(1_000_000_000):
        found[batch.topic] = found.get(batch.topic, 0) + len(batch)

Errors are a ``ParameterError`` for unusable values, and an
``EngineError`` for a simulation that cannot continue. Other modules of this package are private
and change without notice.
"""

# The public API only: modules of this package import from each other, never from here.
from rpud_sim.drilling.mount import MountParameters, MountState
from rpud_sim.drilling.process import ProcessState
from rpud_sim.drilling.rock import RockParameters, preset_layer
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.messages.batch import Batch
from rpud_sim.model.engine import EngineError
from rpud_sim.model.parameters import Parameters, preset
from rpud_sim.simulation.actuator import ActuatorParameters, ActuatorReading
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.changes import Change, Clear, Configure, Inject
from rpud_sim.simulation.commands import ActiveCommands, Drive, Feed, MountMotion, WeightOnBit
from rpud_sim.simulation.configuration import (
    PARAMETERS,
    Configuration,
    Settings,
    read_parameter_file,
    to_configuration,
    to_settings,
)
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount
from rpud_sim.simulation.ensemble import Ensemble, Member, compile_kernels, phases_of, run_ensemble
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultLedger, FaultRecord
from rpud_sim.simulation.fields import CommandCounts
from rpud_sim.simulation.metrics import METRICS, Metrics
from rpud_sim.simulation.plan import Beginning, Journal, JournalEntry, Plan, initial_phases
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.sampling import Samples, Times
from rpud_sim.simulation.scenario_file import read_scenario
from rpud_sim.simulation.topics import TOPICS, DrillTopic

__all__ = [
    "KINDS",
    "METRICS",
    "PARAMETERS",
    "TOPICS",
    "ActiveCommands",
    "ActuatorParameters",
    "ActuatorReading",
    "Batch",
    "Beginning",
    "Block",
    "Change",
    "Clear",
    "CommandCounts",
    "Configuration",
    "Configure",
    "DrillTopic",
    "Drive",
    "EnergyAccount",
    "EngineError",
    "Ensemble",
    "Fault",
    "FaultLedger",
    "FaultRecord",
    "Feed",
    "FeedAccount",
    "Inject",
    "Journal",
    "JournalEntry",
    "Member",
    "Metrics",
    "MountMotion",
    "MountParameters",
    "MountState",
    "ParameterError",
    "Parameters",
    "Plan",
    "ProcessState",
    "RockParameters",
    "Run",
    "Samples",
    "Settings",
    "Times",
    "WeightOnBit",
    "compile_kernels",
    "initial_phases",
    "phases_of",
    "preset",
    "preset_layer",
    "read_parameter_file",
    "read_scenario",
    "run_ensemble",
    "to_configuration",
    "to_settings",
]
