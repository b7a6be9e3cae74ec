"""Packages that only some of the program needs."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def import_extra(module: str, purpose: str, packages: str) -> Any:
    """Return a module; if it is missing, the error shows what needs it and what to install."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        missing = (error.name or module).partition(".")[0]
        text = f"{purpose} needs {missing}: pip install {packages}, or in a clone make setup"
        raise ModuleNotFoundError(text, name=missing) from None
