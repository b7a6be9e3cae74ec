"""Entries of a campaign file: their checks, each with the place for the error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, Quantity, did_you_mean, shown, suggestion
from rpud_sim.testing.campaign.specification import CampaignError

Place = tuple[str | int, ...]


def mapping(name: str, value: Any, place: Place) -> Mapping[Any, Any]:
    """Return a mapping."""
    if not isinstance(value, Mapping):
        raise CampaignError(f"{name} = {shown(value)} is no mapping", place)
    return value


def check_keys(
    entries: Mapping[Any, Any], known: Sequence[str], place: Place, needed: Sequence[str] = ()
) -> None:
    """Check that all keys of a mapping are known, and that none is missing."""
    for key in entries:
        if key not in known:
            raise CampaignError(f"{shown(key)}: {did_you_mean(key, known)}", (*place, str(key)))
    for key in needed:
        if key not in entries:
            raise CampaignError(f"{key} is missing", place)


def number(name: str, value: Any, quantity: Quantity, place: Place) -> float:
    """Return a number within its range."""
    try:
        return float(quantity.check(name, value))
    except ParameterError as error:
        raise CampaignError(error, place) from None


def one_line(name: str, value: Any, place: Place) -> str:
    """Return a text of one line."""
    if not (isinstance(value, str) and value.strip() and value.isprintable()):
        raise CampaignError(f"{name} = {shown(value)} is not a text of one line", place)
    return value


def texts(name: str, value: Any, place: Place) -> tuple[str, ...]:
    """Return a list of texts of one line each."""
    if not isinstance(value, list):
        raise CampaignError(f"{name} = {shown(value)} is no list", place)
    return tuple(one_line(name, each, (*place, index)) for index, each in enumerate(value))


def find_file(given: Any, folder: Path, name: str, place: Place) -> Path:
    """Return the path of a file, which is given relative to a folder."""
    path = folder / one_line(name, given, place)
    if path.is_file():
        return path.resolve()
    beside = []
    if path.parent.is_dir():
        beside = sorted(other.name for other in path.parent.iterdir() if other.is_file())
    hint = suggestion(path.name, beside)
    raise CampaignError(f"{name} = {shown(given)} is no file in {folder}{hint}", place)
