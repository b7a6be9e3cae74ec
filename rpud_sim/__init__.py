"""Simulator of a rotary-percussive ultrasonic drill.

::

    import rpud_sim

    run = rpud_sim.simulate(20, weight_on_bit=20)     # 20 s at 20 N
    run.metrics["drill_tool_impact_rate"]             # 1/s
    run["contact_force"]["peak_force"]                # a NumPy array [N]
    run.plot()

    rpud_sim.sweep({"weight_on_bit": [5, 10, 20]}, 2, seeds=8)   # a pandas frame

    drill = rpud_sim.Drill(weight_on_bit=8)           # step by step
    drill.press(20)
    drill.step(0.1)

Values are in SI units, times in seconds, positions positive toward the rock. Other modules of the
package that docs/reference/python.md does not name are private.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rpud_sim.foundation.quantities import ParameterError
    from rpud_sim.scripting.bags import DrillBag, compare, open, verify
    from rpud_sim.scripting.drill import Drill
    from rpud_sim.scripting.runs import DrillRun, simulate
    from rpud_sim.scripting.sweep import sweep
    from rpud_sim.simulation.configuration import PARAMETERS

    __version__: str

_MODULES = {
    "foundation.quantities": ("ParameterError",),
    "scripting.bags": ("DrillBag", "compare", "open", "verify"),
    "scripting.drill": ("Drill",),
    "scripting.runs": ("DrillRun", "simulate"),
    "scripting.sweep": ("sweep",),
    "simulation.configuration": ("PARAMETERS",),
}

__all__ = [
    "PARAMETERS",
    "Drill",
    "DrillBag",
    "DrillRun",
    "ParameterError",
    "__version__",
    "compare",
    "open",
    "simulate",
    "sweep",
    "verify",
]


def __getattr__(name: str) -> Any:
    """Return a public name, and keep it; the package itself imports nothing."""
    if name == "__version__":
        from rpud_sim.simulation.versions import version_of

        return globals().setdefault(name, version_of("rpud_sim"))
    for module, names in _MODULES.items():
        if name in names:
            return globals().setdefault(name, getattr(import_module(f"{__name__}.{module}"), name))
    text = f"module {__name__!r} has no attribute {name!r}"
    raise AttributeError(text, name=name, obj=sys.modules[__name__])  # for a suggestion


def __dir__() -> list[str]:
    """Return the public names, also those that are not loaded yet."""
    return __all__
