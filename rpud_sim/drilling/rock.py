"""Rock: layers by their depth, presets, files of strata, and the depth of a hole by percussion."""

from __future__ import annotations

import dataclasses
import functools
import math
import os
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.quantities import (
    ParameterError,
    ParameterGroup,
    Quantity,
    choice,
    declarations,
    did_you_mean,
    number,
    quantities,
    short_repr,
    text,
)
from rpud_sim.foundation.schema import key, list_of, name_in, read
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import YamlNode, open_yaml, parse_yaml, yaml_node

_PROPERTIES = ("specific_energy", "strength", "threshold_energy", "abrasiveness", "friction")
ROCKS: Mapping[str, Mapping[str, float]] = {
    name: dict(zip(_PROPERTIES, values, strict=True))
    for name, *values in (
        # Compacted JSC-1A. Strength and specific energy are assumed: a granular soil has no
        # compressive strength by itself; a compacted one bears some 0.1 MPa under a small bit.
        ("regolith", 5e6, 1e5, 0.0, 1.0, 0.6),
        # Of the others the specific energy is the strength.
        ("chalk", 10e6, 10e6, 0.002, 0.3, 0.4),
        ("limestone", 50e6, 50e6, 0.01, 1.0, 0.5),
        ("sandstone", 75e6, 75e6, 0.02, 2.0, 0.5),
        ("basalt", 200e6, 200e6, 0.05, 3.0, 0.5),
    )
}

LONGEST_NAME = 60
BOTTOM = Quantity("m", "depth at which the rock ends", 0.0, 1e4, exclusive=True)


@dataclasses.dataclass(frozen=True)
class Layer(ParameterGroup):
    """Layer of rock, immutable."""

    name: str = text("", "a name", "name of the layer")
    depth_from: float = number(0.0, "m", "depth at which the layer begins", 0.0, 1e4)
    specific_energy: float = number(
        75e6, "J/m^3", "least energy that cuts or breaks one unit of volume", 1e3, 1e12
    )
    strength: float = number(75e6, "Pa", "compressive strength", 1e2, 1e12)
    threshold_energy: float = number(
        0.0, "J", "energy of an impact below which it breaks nothing", 0.0, 1e3
    )
    abrasiveness: float = number(0.0, "", "CERCHAR abrasiveness index", 0.0, 10.0)
    friction: float = number(0.5, "", "coefficient of friction of the wear flat", 0.0, 2.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.name.isprintable() and len(self.name) <= LONGEST_NAME):
            raise ParameterError(
                f"name = {short_repr(self.name)} is not printable text of at most "
                f"{LONGEST_NAME} letters"
            )


# What a layer of a file may state, in the order of the documentation.
LAYER_QUANTITIES: Mapping[str, Quantity] = quantities(Layer)
STRENGTH = LAYER_QUANTITIES["strength"]
_LAYER_KEYS = {
    **{name: declaration.allowed for name, declaration in declarations(Layer).items()},
    "rock": name_in(ROCKS, "a rock"),
}


@dataclasses.dataclass(frozen=True)
class Strata:
    """Layers from the surface downward, immutable."""

    # at least one; the first begins at depth zero, each other one below the one before
    layers: tuple[Layer, ...]
    bottom: float = math.inf  # depth at which the rock ends [m]; infinite if it does not

    def __post_init__(self) -> None:
        if not self.layers:
            raise ParameterError("layers = [] has no layer; at least one is needed")
        above = -math.inf
        for number_, layer in enumerate(self.layers, 1):
            place = f"layer {number_} ({layer.name}): depth_from = {layer.depth_from:g} m"
            if number_ == 1 and layer.depth_from != 0.0:
                raise ParameterError(f"{place} is not 0 m, where the first layer begins")
            if layer.depth_from <= above:
                raise ParameterError(
                    f"{place} is not below {above:g} m, where the one above begins"
                )
            above = layer.depth_from
        if not math.isinf(self.bottom):
            BOTTOM.check("bottom", self.bottom)
            if self.bottom <= above:
                raise ParameterError(
                    f"bottom = {self.bottom:g} m is not below {above:g} m, where the last layer "
                    "begins"
                )

    def end_of(self, number_: int) -> float:
        """Depth at which a layer ends [m]; infinite for the last one without bottom."""
        if number_ + 1 < len(self.layers):
            return self.layers[number_ + 1].depth_from
        return self.bottom

    def to_text(self) -> str:
        """Return one line of YAML from which ``find_strata`` makes the same strata."""
        content: dict[str, Any] = {"layers": [dataclasses.asdict(layer) for layer in self.layers]}
        if not math.isinf(self.bottom):
            content["bottom"] = self.bottom
        return json_text(content, ensure_ascii=False)


def preset_layer(rock: str, depth_from: float = 0.0) -> Layer:
    """Return the layer of a rock by its name, from zero depth on, with the values of its kind."""
    return Layer(name=rock, depth_from=depth_from, **ROCKS[rock])


@functools.lru_cache(maxsize=64)
def inclusion_in(layer: Layer, strength: float) -> Layer:
    """Return the rock of a stone in a layer, nowhere softer than the layer.

    Its specific energy is its strength, its threshold energy basalt's in proportion to it
    (assumed).
    """
    basalt = ROCKS["basalt"]
    threshold = basalt["threshold_energy"] * strength / basalt["strength"]
    return dataclasses.replace(
        layer,
        strength=max(strength, layer.strength),
        specific_energy=max(strength, layer.specific_energy),
        threshold_energy=max(threshold, layer.threshold_energy),
    )


def uniform_strata(specific_energy: float) -> Strata:
    """Return one layer without end, with the specific energy [J/m^3] as its strength."""
    strength = min(max(specific_energy, STRENGTH.minimum), STRENGTH.maximum)
    return Strata((Layer("rock", 0.0, specific_energy, strength),))


def find_strata(choice: str) -> Strata:
    """Return the strata of a rock's name, of one line of YAML in braces, or of a file.

    An error of a file has its name, the line and the layer.
    """
    if choice in ROCKS:
        return Strata((preset_layer(choice),))
    if choice.lstrip().startswith("{"):
        try:
            content = parse_yaml(choice)
        except ParameterError as error:
            raise ParameterError(f"strata {error}") from None
        return _strata_at(yaml_node(content, "strata"))
    if not os.path.isfile(choice) and "/" not in choice and "." not in choice:
        raise ParameterError(
            f"strata = {short_repr(choice)} is neither a file nor a "
            f"rock{did_you_mean(choice, ROCKS)}"
        )
    return _strata_at(open_yaml(choice))


def _layer_at(entry: YamlNode) -> Layer:
    """Return a layer: of a rock, whose values other keys replace, or of all of its keys."""
    given = read(entry, _LAYER_KEYS)
    if (rock := given.pop("rock", None)) is None:
        entry.mapping(needed=declarations(Layer))
        return Layer(**given)
    entry.mapping(needed=("depth_from",))
    return dataclasses.replace(preset_layer(rock), **given)


@dataclasses.dataclass(frozen=True)
class _StrataFile:
    layers: tuple[Layer, ...] = key(list_of(_layer_at))
    bottom: float = key(BOTTOM, math.inf)


def _strata_at(content: YamlNode) -> Strata:
    file = read(content, _StrataFile)
    with content.errors():
        return Strata(file.layers, file.bottom)


@dataclasses.dataclass(frozen=True)
class StrataParameters(ParameterGroup):
    """Choice of the strata.

    A file is read when this is made, and its content in one line replaces its path.
    """

    strata: str = text(
        "",
        "a rock, a path or YAML in braces",
        "layers of the rock; one layer of the parameters rock_* if empty",
        longest=1 << 20,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        found = find_strata(self.strata) if self.strata else None
        object.__setattr__(self, "found", found)
        if found and not (self.strata in ROCKS or self.strata.lstrip().startswith("{")):
            object.__setattr__(self, "strata", found.to_text())

    found: ClassVar[Strata | None]  # the strata; None if none are chosen


# Message about a hole at its greatest depth.
NO_DEEPER = "the hole is as deep as the drill tool is long: it gets no deeper"
# The penetration rate is the mean over this time [ns].
RATE_WINDOW = SECOND


@dataclasses.dataclass(frozen=True)
class RockParameters(ParameterGroup):
    """Parameters of the rock, in SI units; the defaults are the sandstone of Section V.

    The specific energy is the sandstone's compressive strength, 75 MPa: the least that drilling
    takes, very roughly, after Teale, "The concept of specific energy in rock drilling", Int. J.
    Rock Mech. Min. Sci. 2 (1965) 57-73. The hole has the area of part II of the drill tool. The
    share of the energy is assumed; docs/explanation/drilling.md gives its reasons.
    """

    rock_model: str = choice(
        "none", ("none", "specific_energy"), "whether the hole gets deeper by the impacts' energy"
    )
    rock_specific_energy: float = number(
        75e6,
        "J/m^3",
        "energy that breaks one unit of volume of the rock",
        1e3,
        1e12,
        changeable=True,
    )
    rock_energy_transfer: float = number(
        0.01,
        "",
        "share of the energy that an impact leaves in drill tool and rock, which breaks the rock",
        0.0,
        1.0,
    )
    hole_area: float = number(2.0e-5, "m^2", "cross-sectional area of the hole", 1e-8, 1.0)


class PercussionDepth:
    """Depth of the hole by percussion alone; depth and rate are NaN without a rock model.

    Each impact deepens it by the energy that it leaves in drill tool and rock, times the share that
    breaks the rock, over specific energy and area. At most it is as deep as the tool is long [m].
    """

    def __init__(self, parameters: RockParameters, deepest: float) -> None:
        self._modelled = parameters.rock_model != "none"
        self._metres_per_joule = parameters.rock_energy_transfer / (
            parameters.rock_specific_energy * parameters.hole_area
        )
        self._deepest = deepest
        self._depth = 0.0 if self._modelled else math.nan
        self._times = np.empty(0, np.int64)
        self._depths = np.empty(0)

    @property
    def depth(self) -> float:
        return self._depth

    def add(self, impacts: np.ndarray, hardness: float = 1.0, clearing: float = 1.0) -> None:
        """Deepen the hole by impacts, in order; how blocks divide them makes no difference.

        ``hardness`` is a factor on the specific energy, ``clearing`` one on the progress.
        """
        if not (self._modelled and len(impacts)):
            return
        deeper = np.maximum(impacts["energy_transferred"], 0.0)
        deeper *= self._metres_per_joule * clearing / hardness
        # One after the other: a sum in pairs would depend on the blocks.
        depths = np.add.accumulate(np.concatenate([[self._depth], deeper]))
        depths = np.minimum(depths, self._deepest)
        self._depth = float(depths[-1])
        fractions = np.rint(impacts["fraction"] * SECOND).astype(np.int64)
        self._times = np.concatenate([self._times, impacts["seconds"] * SECOND + fractions])
        self._depths = np.concatenate([self._depths, np.diff(depths)])
        recent = np.searchsorted(self._times, self._times[-1] - RATE_WINDOW, side="right")
        self._times, self._depths = self._times[recent:], self._depths[recent:]

    def penetration_rate(self, time: int) -> float:
        """Return the mean rate of the second before a time [ns], or since zero if shorter [m/s]."""
        if not self._modelled:
            return math.nan
        recent = np.searchsorted(self._times, time - RATE_WINDOW, side="right")
        window = min(time, RATE_WINDOW) / SECOND
        return math.fsum(self._depths[recent:]) / window if window > 0.0 else 0.0
