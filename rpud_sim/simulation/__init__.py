"""The drill under commands and faults: the public face for scripts that simulate without ROS."""

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.engine import EngineError
from rpud_sim.model.parameters import Parameters, preset

__all__ = ["EngineError", "ParameterError", "Parameters", "preset"]
