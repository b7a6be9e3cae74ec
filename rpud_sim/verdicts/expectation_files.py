"""Files of expectations in YAML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.foundation.yaml_files import read_yaml_text, yaml_lines
from rpud_sim.verdicts.expectation import Expectation
from rpud_sim.verdicts.notation import Path as Place
from rpud_sim.verdicts.notation import to_formula, to_plain
from rpud_sim.verdicts.units import ExpectationError

_KEYS = ("name", "requirement", "expect")


def read_expectations(path: str | Path) -> tuple[Expectation, ...]:
    """Read a file of expectations; an error names the file and the line."""
    try:
        # Without truth values: off is a kind of fault, and `is: true` a text as `is: running`.
        content, text = read_yaml_text(path, truth_values=False)
    except ParameterError as error:
        raise ExpectationError(error) from None
    try:
        return parse_expectations(content)
    except ExpectationError as error:
        lines = yaml_lines(text) if content is not None else {}
        place = error.path
        while place and place not in lines:
            place = place[:-1]
        raise ExpectationError(f"{path}:{lines.get(place, 1)}: {error}", error.path) from None


def parse_expectations(content: Any) -> tuple[Expectation, ...]:
    """Return the expectations of a file's content; the path of an error leads to the place."""
    if not isinstance(content, Mapping) or "expectations" not in content:
        raise ExpectationError("it holds no expectations:")
    for key in content:
        if key != "expectations":
            raise ExpectationError(f"{shown(key)} is not expectations", (str(key),))
    entries = content["expectations"]
    if not isinstance(entries, list) or not entries:
        raise ExpectationError("expectations is no list with entries", ("expectations",))
    found: dict[str, Expectation] = {}
    for number, entry in enumerate(entries):
        place = ("expectations", number)
        expectation = parse_expectation(entry, place)
        if expectation.name in found:
            raise ExpectationError(f"name {shown(expectation.name)} is taken already", place)
        found[expectation.name] = expectation
    return tuple(found.values())


def parse_expectation(entry: Any, place: Place = ()) -> Expectation:
    """Return the expectation of one entry: ``name`` and ``expect``, perhaps ``requirement``."""
    if not isinstance(entry, Mapping):
        raise ExpectationError(f"{shown(entry)} is not a mapping", place)
    for key in entry:
        if key not in _KEYS:
            raise ExpectationError(f"{shown(key)}: {did_you_mean(key, _KEYS)}", (*place, str(key)))
    for key in ("name", "expect"):
        if key not in entry:
            raise ExpectationError(f"the expectation lacks its {key}", place)
    for key in ("name", "requirement"):
        value = entry.get(key, "-")
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            raise ExpectationError(f"{key} = {shown(value)} is not a text of one line", place)
    inner = (*place, "expect")
    formula = to_formula(entry["expect"], inner)
    try:
        return Expectation(entry["name"], formula, entry.get("requirement", ""))
    except ExpectationError as error:
        raise ExpectationError(error, inner) from None


def expectations_to_yaml(expectations: Iterable[Expectation]) -> str:
    """Return the file that ``read_expectations`` reads back as these expectations."""
    entries = [
        {
            "name": each.name,
            **({"requirement": each.requirement} if each.requirement else {}),
            "expect": to_plain(each.formula),
        }
        for each in expectations
    ]
    text: str = yaml.safe_dump({"expectations": entries}, sort_keys=False, allow_unicode=True)
    return text
