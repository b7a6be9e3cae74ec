"""The model under commands: configuration, trajectory sampling, statistics and ensembles."""

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
)
from rpud_sim.model.segment import SEGMENT

__all__ = [
    "CONTACT_MODELS",
    "NAMES",
    "QUANTITIES",
    "REGIMES",
    "SEGMENT",
    "ParameterError",
    "Parameters",
    "Quantity",
    "check_choice",
    "preset",
]
