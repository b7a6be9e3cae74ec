"""What every screen draws of a drill: its plots, numbers of its last second, its hole."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpud_sim.drilling.rock import ROCKS, find_strata
from rpud_sim.foundation.quantities import QUANTITIES, ParameterError
from rpud_sim.viewer.history import Bins, Impacts, Layer

GAP = 3.0  # distance of two points, in usual ones, from which on there is a gap between them
SECTION = 0.02  # length of the motion that a section shows [s]
MOTION = ("nodal_plane", "actuator", "free_mass", "drill_tool", "contact_force")
IMPACTS = ("impact_rate", "peak_force")  # quantities that the impacts themselves show
TIMES = ("weight_on_bit_applied", "drive_applied", "feed_applied")  # stamps in a status

_POINT = 2  # width of a part of a band [px]
_LEAST_IMPACTS = 8  # in a part of the time that shows their spread
_RATES = 10  # parts of a second, whose rates of impacts are compared
_SPARK = 60  # means of a sparkline, one a second
_TIMELINE = 1000  # bins
_FINEST = 1 << 20  # parts of a range: as many as there are bins
_COLOURS = 6  # of layers of the rock
_LOG_PARTS = 200  # of the depth, at most
_LOG_BINS = 4000  # of the run, for rate and torque over the depth
_NUMBERS = {  # quantities that a number shows: the first that there is
    "reacting_force": ("reacting_force",),
    "power": ("electrical_power", "actuator_power"),
    "penetration_rate": ("penetration_rate",),
}
# Kinds of layers; bands are of quantities that change faster than a screen shows. Others are lines.
_KINDS = {
    **dict.fromkeys(("weight_on_bit", "drive_voltage", "drive_frequency"), "steps"),
    **dict.fromkeys(("peak_force", "reacting_force", "mount_force", "torque"), "band"),
    **dict.fromkeys(("drive_torque", "rotation_rate", "feed", "mount_position"), "band"),
    **dict.fromkeys(("nodal_plane", "drill_tool"), "band"),
}
# Choices of the last plot: title and quantities by identifier.
_MORE = {
    "depth": ("depth of the hole", "depth"),
    "rate": ("rate of penetration", "penetration_rate"),
    "power": ("power, mean of a second", "actuator_power", "absorbed_power", "electrical_power"),
    "impacts": ("impacts per second", "impact_rate"),
    "torque": ("torque", "torque", "drive_torque"),
    "rotation": ("rotation", "rotation_rate"),
    "feed": ("feed and mount", "feed", "mount_position"),
    "arm": ("force of the arm on the mount", "mount_force"),
    "positions": ("positions", "nodal_plane", "drill_tool"),
    "voltage": ("voltage of the drive", "drive_voltage"),
    "frequency": ("drive and resonance", "drive_frequency", "resonance_frequency"),
    "current": ("current of the actuator", "current"),
    "vibration": ("amplitude of the vibration", "vibration_amplitude"),
    "temperature": ("temperature of the actuator", "temperature"),
    "cuttings": ("cuttings in the flutes", "packed_cuttings"),
    "wear": ("wear of the bit", "bit_wear"),
    "lateness": ("how late the latest block was", "lateness"),
}
# Identifier and title of each plot, and its choices.
_PLOTS = (
    ("peak_force", "peak force of the impacts", {"": ("", "peak_force", "contact_force")}),
    ("load", "reacting force", {"": ("", "reacting_force", "weight_on_bit")}),
    ("motion", "motion", {"": ("", "actuator", "free_mass", "drill_tool")}),
    ("more", "more", _MORE),
)


def drill_plots(
    has: Callable[[str], bool], others: Collection[dict[str, Any]] = ()
) -> list[dict[str, Any]]:
    """Return the plots of a drill as a frame has them.

    ``has`` says of a quantity whether there is any of it; ``others`` are further choices of the
    last plot.
    """
    plots = []
    for name, title, choices in _PLOTS:
        shown = [
            choice_of(each, heading, labels)
            for each, (heading, *quantities) in choices.items()
            if (labels := {each: QUANTITIES[each].label for each in quantities if has(each)})
        ]
        if name == "more":
            shown += others
        if shown:
            plots.append({"id": name, "title": title, "choices": shown})
    return plots


def choice_of(name: str, title: str, labels: Mapping[str, str]) -> dict[str, Any]:
    """Return a choice of a plot with a layer for each quantity, by the labels of these."""
    layers = [
        {
            "quantity": quantity,
            "label": label,
            "kind": _KINDS.get(quantity, "line" if quantity in QUANTITIES else "band"),
        }
        for quantity, label in labels.items()
    ]
    return {"id": name, "title": title, "layers": layers}


def chosen_quantities(plots: Collection[dict[str, Any]], choices: Any) -> dict[str, str]:
    """Return kinds of layers by the quantity that is shown, with these choices by plot.

    The plot of the motion is drawn from sections.
    """
    found: dict[str, str] = {}
    for plot in plots:
        options = {each["id"]: each["layers"] for each in plot["choices"]}
        layers = options.get(choices.get(plot["id"]), plot["choices"][0]["layers"])
        if plot["id"] != "motion":
            found |= {layer["quantity"]: layer["kind"] for layer in layers}
    return found


@dataclass(frozen=True)
class Picture:
    """Quantities of a drill over its run, from which the fields of a frame are made."""

    bins: Bins
    impacts: Impacts
    names: Callable[[str], str | None]  # name of a quantity in the bins; None if it has no values
    since: float  # time from which on there are any values [s]
    end: float  # time up to which there are any [s]
    known: float = math.inf  # time up to which all values are there; only samples beyond it [s]
    samples: float = 0.0  # beyond it [1/s]
    most: float = math.inf  # impacts of a range whose quantiles are computed; more have extremes

    def view(self, start: float, end: float, width: int, kinds: Mapping[str, str]) -> Layer:
        """Return the field ``view`` of a frame: layers of quantities by their kinds."""
        layers = self.impact_layers(start, end, width, kinds)
        for quantity, kind in kinds.items():
            if quantity not in IMPACTS and (name := self.names(quantity)):
                layer = self.line(name, start, end, width // _POINT)
                shown = ("t", "mean") if kind == "line" else ("t", "mean", "low", "high")
                layers[quantity] = {each: layer[each] for each in shown}
        found = {"start": start, "end": end, "detail": "overview"}
        return {**found, "band": "least-greatest", "layers": layers}

    def line(self, name: str, start: float, end: float, parts: int = _TIMELINE) -> Layer:
        """Return a signal of the bins in about so many parts of a range of time [s]."""
        return with_gaps(self.bins.view(name, *self._range(start, end, parts)))

    def impact_layers(
        self, start: float, end: float, width: int, wanted: Mapping[str, str]
    ) -> dict[str, Layer]:
        """Return rate and peak forces of the impacts, as far as they are wanted."""
        name, layers = self.names("peak_force"), dict[str, Layer]()
        if name is None:
            return layers
        start, end, parts = self._range(start, end, width // _POINT)
        count = len(self.impacts.between(start, end)[0])
        shown = start, end, min(parts, max(1, count // _LEAST_IMPACTS))
        if "impact_rate" in wanted:
            layers["impact_rate"] = with_gaps(self.impacts.rate(*shown))
        if "peak_force" not in wanted:
            return layers
        if count >= self.most:
            extremes = self.line(name, start, end, width // _POINT)
            return layers | {"peak_force": {**extremes, "band": "least-greatest"}}
        spread = self.impacts.spread(*shown)
        outliers = spread.pop("outliers")
        layers["peak_force"] = {**with_gaps(spread), "band": "5-95 %", "outliers": outliers}
        return layers

    def numbers(self, now: float) -> dict[str, Layer | None]:
        """Return the field ``numbers`` of a frame: of the last second before a time [s]."""
        begin = min(max(now - 1.0, self.since), now - 1e-3)
        seconds = min(_SPARK, max(1, int(now - self.since)))
        found: dict[str, Layer | None] = dict.fromkeys((*IMPACTS, *_NUMBERS))
        if name := self.names("peak_force"):
            times, peaks = (each.astype(float) for each in self.impacts.between(begin, now))
            counts = np.histogram(times, _RATES, (begin, now))[0] * self.impacts.stride
            rates = counts * _RATES / (now - begin)
            edges = now - np.arange(seconds, -1, -1.0)
            times, _ = self.impacts.between(edges[0], now)
            spark = np.diff(np.searchsorted(times, edges)) * self.impacts.stride
            found["impact_rate"] = _figures(rates, rates, rates, spark)
            means = self.bins.view(name, edges[0], now, seconds)["mean"]
            found["peak_force"] = _figures(peaks, peaks, peaks, means)
        for number, quantities in _NUMBERS.items():
            if name := next(filter(None, map(self.names, quantities)), None):
                means = self.bins.view(name, now - seconds, now, seconds)["mean"]
                bins = self.bins.view(name, begin, now, _FINEST)
                if not np.isfinite(bins["mean"]).any():  # a status is as old as a second
                    bins = self.bins.view(name, begin - 1.0, now, _FINEST)
                found[number] = _figures(bins["low"], bins["mean"], bins["high"], means)
        return found

    def hole(self, now: float, parameters: Mapping[str, Any]) -> Layer | None:
        """Return the field ``hole`` of a frame at a time [s]; None without a rock or a depth."""
        names = [self.names(each) for each in ("depth", "penetration_rate", "torque")]
        layers, end = rock_layers(parameters), max(now, self.bins.width)
        if not layers or names[0] is None or names[1] is None:
            return None
        depth, rate, torque = (
            self.bins.view(name, 0.0, end, _LOG_BINS)["mean"] if name else np.full(1, np.nan)
            for name in names
        )
        latest = self.latest(names[0], now)
        if latest is None:
            latest = next((each for each in depth[::-1] if np.isfinite(each)), 0.0)
        log = well_log(depth, rate, torque if names[2] else None)
        return {"depth": latest, "layers": layers, "log": log}

    def latest(self, name: str, now: float) -> float | None:
        """Return the latest value of a signal of the bins in the second before a time [s]."""
        means = self.bins.view(name, now - 1.0, now, _FINEST)["mean"]
        known = means[np.isfinite(means)]
        return float(known[-1]) if len(known) else None

    def _range(self, start: float, end: float, parts: int) -> tuple[float, float, int]:
        """Return a range as far as there are values, and the number of its parts.

        As long as it is not known whole, a part is so long that it holds something of the sample.
        """
        first, last = max(start, self.since), min(end, self.end)
        if last > self.known:
            parts = min(parts, int(self.samples * (last - first)))
        else:
            parts = math.ceil(parts * (last - first) / max(end - start, 1e-9))
        return first, max(first, last), max(1, parts)


def with_gaps(layer: Layer) -> Layer:
    """Return a layer without its NaN, and with NaN between points that are far apart."""
    valid = np.isfinite(layer["mean"])
    layer = {name: values[valid] for name, values in layer.items()}
    times = layer["t"]
    steps = np.diff(times)
    places = np.flatnonzero(steps > GAP * max(usual(steps), 1e-9)) + 1
    middles = 0.5 * (times[places - 1] + times[places])
    return {
        name: np.insert(values, places, middles if name == "t" else np.nan)
        for name, values in layer.items()
    }


def usual(steps: np.ndarray) -> float:
    """Return the usual distance between points: nine of ten are not longer."""
    return float(np.quantile(steps, 0.9, method="lower")) if len(steps) else 0.0


def _figures(low: np.ndarray, mean: np.ndarray, high: np.ndarray, spark: np.ndarray) -> Layer:
    known = np.isfinite(mean)
    found: Layer = dict.fromkeys(("mean", "least", "greatest"))
    if known.any():
        found["mean"] = mean[known].mean()
        found["least"], found["greatest"] = low[known].min(), high[known].max()
    with np.errstate(over="ignore"):
        spark = spark.astype(np.float32)
    return {**found, "spark": spark[np.isfinite(spark)][-_SPARK:]}


def rock_layers(parameters: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the layers of the rock that a run's parameters choose; none without a rock."""
    choice = str(parameters.get("strata") or "")
    if not choice:
        if parameters.get("rock_model", "none") == "none":
            return []
        return [{"from": 0.0, "to": None, "name": "rock", "colour": 0}]
    if not choice.lstrip().startswith("{") and choice not in ROCKS:
        return []  # a path: what is recorded or heard never makes this program read a file
    try:
        strata = find_strata(choice)
    except ParameterError:  # another program wrote it
        return []
    names = list(dict.fromkeys(layer.name for layer in strata.layers))
    return [
        {
            "from": layer.depth_from,
            "to": end if np.isfinite(end := strata.end_of(number)) else None,
            "name": layer.name,
            "colour": names.index(layer.name) % _COLOURS,
        }
        for number, layer in enumerate(strata.layers)
    ]


def well_log(
    depth: np.ndarray, rate: np.ndarray, torque: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Return means of rate [m/s] and torque [N m] over equal parts of the depth [m].

    All have one value for each moment, shape (n,); what is not finite is left out.
    """
    valid = np.isfinite(depth) & np.isfinite(rate) & (depth >= 0.0)
    greatest = float(depth[valid].max(initial=0.0))
    if greatest <= 0.0:
        return dict.fromkeys(("depth", "rate", "torque"), np.empty(0))
    part = np.minimum((depth[valid] / greatest * _LOG_PARTS).astype(int), _LOG_PARTS - 1)
    used, places, counts = np.unique(part, return_inverse=True, return_counts=True)
    log = {"depth": (used + 0.5) * greatest / _LOG_PARTS}
    log["rate"] = np.bincount(places, rate[valid]) / counts
    none = np.full(len(used), np.nan)
    log["torque"] = none if torque is None else np.bincount(places, torque[valid]) / counts
    return {name: values.astype(np.float32) for name, values in log.items()}
