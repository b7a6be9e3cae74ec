"""Specification of a sensitivity study, read from YAML: each input's interval and its source."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import (
    ParameterError,
    Quantity,
    did_you_mean,
    shown,
    shown_name,
)
from rpud_sim.foundation.yaml_files import read_yaml
from rpud_sim.model.parameters import QUANTITIES
from rpud_sim.simulation import Parameters, preset

_MOST_SAMPLES = 2**16
_DURATION = Quantity("s", "", 0.01, 1e4)
_SETTLING = Quantity("s", "", 0.0, 1e4)
_SAMPLES = Quantity("", "", 2, _MOST_SAMPLES, whole=True)
_SEED = Quantity("", "", 0, 2**32 - 1, whole=True)


class SensitivityError(ValueError):
    """Sensitivity study that is not possible; the text gives the reason in one line."""


@dataclasses.dataclass(frozen=True)
class Interval:
    """Interval of an input, in which it is distributed evenly."""

    minimum: float  # least value, SI units
    maximum: float  # greatest value
    source: str  # where the interval comes from


@dataclasses.dataclass(frozen=True)
class Specification:
    """Sensitivity study."""

    samples: int  # of each of the two matrices of Saltelli's design, a power of two
    seed: int  # of the design and of the resampling
    settling: float  # time of each simulation before its figures begin [s]
    duration: float  # time in which its figures are taken [s]
    fixed: Mapping[str, float | str | bool]  # parameters that differ from the regime's preset
    inputs: Mapping[str, Interval]  # interval of each parameter that is uncertain, by name

    @property
    def simulations(self) -> int:
        """Number of simulations; the initial phase is an input as well."""
        return self.samples * (len(self.inputs) + 3)

    def parameters(self, point: Mapping[str, float]) -> Parameters:
        """Return the drill at a point, given by the values of the inputs.

        Raises:
            ParameterError: if a value is outside its range.
        """
        values = {**self.fixed, **point}
        regime = values.pop("regime", "drilling")
        return preset(str(regime)).replace(**values)


def read_specification(path: str | Path) -> Specification:
    """Return the study of a YAML file.

    Raises:
        SensitivityError: if the file is not valid; the text names the file, entry and reason.
    """
    try:
        return parse_specification(read_yaml(path))
    except (ParameterError, SensitivityError) as error:
        text = str(error)
        raise SensitivityError(text if text.startswith(f"{path}") else f"{path}: {text}") from None


def parse_specification(content: Any) -> Specification:
    """Return the study that plain values from YAML describe.

    Raises:
        SensitivityError: if they are not valid; the text names the entry and the reason.
        ParameterError: if a value is outside its range.
    """
    if content is None:
        raise SensitivityError("is empty")
    entries = _mapping("the file", content)
    _check_names("", entries, ("samples", "seed", "settling", "duration", "fixed", "inputs"))
    samples = _SAMPLES.check("samples", entries.get("samples", 256))
    if samples & (samples - 1):
        raise SensitivityError(f"samples = {samples} is no power of two")
    inputs = _mapping("inputs", entries.get("inputs"))
    if not inputs:
        raise SensitivityError("inputs: names no parameter")
    _check_names("inputs.", inputs, QUANTITIES)
    fixed = _mapping("fixed", entries.get("fixed", {}))
    for name in fixed:
        if name in inputs:
            raise SensitivityError(f"inputs.{name}: is fixed as well")
    specification = Specification(
        samples,
        _SEED.check("seed", entries.get("seed", 0)),
        _SETTLING.check("settling", entries.get("settling", 0.5)),
        _DURATION.check("duration", entries.get("duration", 5.0)),
        dict(fixed),
        {name: _interval(name, item) for name, item in inputs.items()},
    )
    for end in ("minimum", "maximum"):  # every value between is in its range if the ends are
        specification.parameters(
            {name: getattr(i, end) for name, i in specification.inputs.items()}
        )
    return specification


def _interval(name: str, content: Any) -> Interval:
    entries = _mapping(f"inputs.{name}", content)
    _check_names(f"inputs.{name}.", entries, ("minimum", "maximum", "source"))
    for key in ("minimum", "maximum", "source"):
        if key not in entries:
            raise SensitivityError(f"inputs.{name}.{key}: is missing")
    minimum, maximum = (
        QUANTITIES[name].check(f"inputs.{name}.{key}", entries[key])
        for key in ("minimum", "maximum")
    )
    if not minimum < maximum:
        raise SensitivityError(
            f"inputs.{name}: minimum {minimum:g} is not below maximum {maximum:g}"
        )
    source = entries["source"]
    if not isinstance(source, str) or not source:
        raise SensitivityError(f"inputs.{name}.source: {shown(source)} is not a text")
    return Interval(minimum, maximum, source)


def _mapping(entry: str, content: Any) -> Mapping[Any, Any]:
    if not isinstance(content, Mapping):
        raise SensitivityError(f"{entry}: holds no mapping")
    return content


def _check_names(prefix: str, content: Mapping[Any, Any], known: Any) -> None:
    for name in content:
        if name not in known:
            raise SensitivityError(
                f"{prefix}{shown_name(name)} is unknown; {did_you_mean(name, known)}"
            )
