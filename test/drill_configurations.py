"""Configurations of a drill with an actuator and a rock."""

from rpud_sim.drilling.rock import RockParameters
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.configuration import Configuration

SANDSTONE = RockParameters(rock_model="specific_energy")
RESONANT = ActuatorParameters(actuator_model="resonance", generator="tracking")
FULL = Configuration(actuator=RESONANT, rock=SANDSTONE)
