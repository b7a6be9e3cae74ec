"""Configurations of a drill with an actuator and a rock, and the paper's tables as printed."""

from pathlib import Path

from rpud_sim.drilling.rock import RockParameters
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.configuration import Configuration, read_parameter_file, to_configuration

CONFIG = Path(__file__).parents[2] / "config"

SANDSTONE = RockParameters(rock_model="specific_energy")
RESONANT = ActuatorParameters(actuator_model="resonance", generator="tracking")
FULL = Configuration(actuator=RESONANT, rock=SANDSTONE)


def tables(regime):
    """Return the parameters of the paper's table for a regime."""
    return to_configuration(read_parameter_file(CONFIG / f"tables_{regime}.yaml")).parameters
