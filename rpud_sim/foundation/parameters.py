"""Declarations of parameters: default, allowed values, and whether they may change.

A frozen dataclass that inherits from ``ParameterGroup`` declares each parameter by one field:

    free_mass: float = number(5e-3, "kg", "mass of the free mass, m_fm", 0.0, 10.0, exclusive=True)

Checks, parameter files, ROS descriptors and ``--set`` derive from it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from rpud_sim.foundation.quantities import Allowed, Choice, Flag, Quantity, Text


@dataclasses.dataclass(frozen=True)
class Declaration:
    """Declaration of a parameter."""

    name: str  # of the parameter
    default: Any  # its value if none is given
    allowed: Allowed  # meaning and allowed values
    changeable: bool  # whether it may change while the drill runs


def number(
    default: float,
    unit: str,
    description: str,
    minimum: float,
    maximum: float,
    *,
    exclusive: bool = False,
    below: bool = False,
    whole: bool = False,
    changeable: bool = False,
) -> Any:
    """Declare a number; see ``Quantity`` for the arguments."""
    allowed = Quantity(unit, description, minimum, maximum, exclusive, below, whole)
    return _field(default, allowed, changeable)


def choice(
    default: str, choices: tuple[str, ...], description: str, *, changeable: bool = False
) -> Any:
    """Declare a choice among words."""
    return _field(default, Choice(description, choices), changeable)


def flag(default: bool, description: str) -> Any:
    """Declare a truth value."""
    return _field(default, Flag(description), False)


def text(default: str, range: str, description: str) -> Any:
    """Declare a text."""
    return _field(default, Text(description, range), False)


def _field(default: Any, allowed: Allowed, changeable: bool) -> Any:
    return dataclasses.field(
        default=default, metadata={"allowed": allowed, "changeable": changeable}
    )


class ParameterGroup:
    """Base of frozen dataclasses whose fields declare parameters; refuses what is not allowed."""

    def __post_init__(self) -> None:
        group: Any = type(self)
        for name, declaration in declarations(group).items():
            given = getattr(self, name)
            if (value := declaration.allowed.check(name, given)) is not given:
                object.__setattr__(self, name, value)


@cache
def declarations(group: type) -> Mapping[str, Declaration]:
    """Return the declarations of a group by name, without fields that declare nothing."""
    fields = [field for field in dataclasses.fields(group) if field.metadata]
    return MappingProxyType(
        {field.name: Declaration(field.name, field.default, **field.metadata) for field in fields}
    )


def quantities(group: type) -> Mapping[str, Quantity]:
    """Return unit, meaning and range of the numbers of a group by name."""
    return {
        name: declaration.allowed
        for name, declaration in declarations(group).items()
        if isinstance(declaration.allowed, Quantity)
    }
