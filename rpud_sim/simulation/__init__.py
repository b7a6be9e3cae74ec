"""The model under commands: configuration, trajectory sampling, statistics and ensembles."""

from rpud_sim.model.engine import EngineError
from rpud_sim.model.parameters import (
    CONTACT_MODELS,
    NAMES,
    QUANTITIES,
    REGIMES,
    ParameterError,
    Parameters,
    Quantity,
    check_choice,
    preset,
    shown,
)
from rpud_sim.model.segment import CONSTANTS, EVENT_ACTUATOR_IMPACT, SEGMENT

__all__ = [
    "CONSTANTS",
    "CONTACT_MODELS",
    "EVENT_ACTUATOR_IMPACT",
    "NAMES",
    "QUANTITIES",
    "REGIMES",
    "SEGMENT",
    "EngineError",
    "ParameterError",
    "Parameters",
    "Quantity",
    "check_choice",
    "preset",
    "shown",
]
