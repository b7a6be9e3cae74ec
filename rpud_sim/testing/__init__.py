"""Tests of software that commands the drill: a pytest plugin, and the same without pytest.

The plugin has the fixtures ``drill``, ``drill_factory`` and ``recording``. ``open_drill`` gives the
same drill to other test runners. An option or an argument that cannot be used is a
``ParameterError``, a drill that does not start or dies a ``DrillError``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rpud_sim.testing.drill import Drill
    from rpud_sim.testing.errors import (
        DrillError,
        ExpectationFailedError,
        LostMessagesError,
        SystemUnderTestError,
    )
    from rpud_sim.testing.setup import open_drill

__all__ = [
    "Drill",
    "DrillError",
    "ExpectationFailedError",
    "LostMessagesError",
    "SystemUnderTestError",
    "open_drill",
]

# Loaded at first use: pytest imports this package in every run, also where no test has a drill.
_MODULES = {
    "Drill": "drill",
    "DrillError": "errors",
    "ExpectationFailedError": "errors",
    "LostMessagesError": "errors",
    "SystemUnderTestError": "errors",
    "open_drill": "setup",
}


def __getattr__(name: str) -> Any:
    """Return a public name."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    """Return the public names, also those that are not loaded yet."""
    return __all__
