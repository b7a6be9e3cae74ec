"""Tests of software that commands the drill: a pytest plugin, and the same without pytest.

The plugin has the fixtures ``drill``, ``drill_factory`` and ``recording``. ``open_drill`` gives the
same drill to other test runners. An option or an argument that cannot be used is a
``ParameterError``, a drill that does not start or dies a ``DrillError``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rpud_sim.testing.errors import (
    DrillError,
    ExpectationFailedError,
    ExpectationUndecidedError,
    LostMessagesError,
    SystemUnderTestError,
)

if TYPE_CHECKING:
    from rpud_sim.testing.drill import LockstepDrill
    from rpud_sim.testing.drill_pool import open_drill

__all__ = [
    "DrillError",
    "ExpectationFailedError",
    "ExpectationUndecidedError",
    "LockstepDrill",
    "LostMessagesError",
    "SystemUnderTestError",
    "open_drill",
]


def __getattr__(name: str) -> Any:
    """Return a public name: pytest imports this package also where no test has a drill."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = "drill" if name == "LockstepDrill" else "drill_pool"
    return getattr(import_module(f"{__name__}.{module}"), name)
