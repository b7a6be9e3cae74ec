"""Strata: layers of rock by their depth."""

from __future__ import annotations

import dataclasses

from rpud_sim.foundation.parameters import ParameterGroup, text


@dataclasses.dataclass(frozen=True)
class StrataParameters(ParameterGroup):
    """Choice of the strata.

    Raises:
        ParameterError: if the strata are unknown.
    """

    strata: str = text(
        "", "a preset's name or a path", "layers of the rock; the parameters rock_* if empty"
    )
