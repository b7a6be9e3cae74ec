"""Changes of a run by commands, from the journal of a bag: what they say and what is in force."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rpud_sim.inspection.report.feed_changes import FeedChanges, FeedCommand, Step

# Kinds of journal entries that end a segment of the run, those of the feed by ``FeedChanges``.
COMMANDS = ("weight_on_bit", "drive", "feed", "configure", "restore", "begin")

MOST_CHANGES = 500  # number of changes that are kept
_MOST_NAMES = 6  # parameters that a text names
_LENGTH = 160  # characters of a text


@dataclass(frozen=True)
class Change:
    """Change by a command."""

    time: float  # since the bag began [s]
    text: str  # what the command asks for
    in_force: str  # commands that are in force from then on
    weight_on_bit: float | None = None  # that is in force from then on [N]; None if it is not known


class CommandsInForce:
    """Commands that are in force, from the entries of a journal in their order."""

    def __init__(self) -> None:
        self.changes: list[Change] = []  # so far, in order, ``MOST_CHANGES`` at most
        self._feed = FeedChanges()
        self._fed: Change | None = None
        self._texts: dict[str, str] = {}
        self._parameters: dict[str, Any] = {}
        self._weight: float | None = None

    def take(self, time: float, kind: str, content: str) -> Change | None:
        """Return the change that an entry makes at a time since the bag began [s]; None if none."""
        if kind not in COMMANDS:
            return None
        try:
            found = json.loads(content)
            found = found if isinstance(found, dict) else {}
            if kind == "feed":
                return self._take_feed(time, FeedCommand(str(found["mode"]), float(found["value"])))
            text = self._text(kind, found)
        except (KeyError, RecursionError, TypeError, ValueError):  # another program wrote it
            text = kind
        return self._add(time, text)

    def _take_feed(self, time: float, feed: FeedCommand) -> Change | None:
        """Return the change that a command of the feed makes; one may be taken back later."""
        self._texts["feed"] = feed.text
        step = self._feed.take(time, feed)
        if step is Step.BEGINS:
            self._fed = self._add(time, feed.text)
            return self._fed
        if step is Step.COMES_BACK and self._fed in self.changes:
            self.changes.remove(self._fed)
        return None

    def _add(self, time: float, text: str) -> Change:
        change = Change(time, text[:_LENGTH], self.text, self._weight)
        if len(self.changes) < MOST_CHANGES:
            self.changes.append(change)
        return change

    @property
    def text(self) -> str:
        return ", ".join(self._texts.values())[:_LENGTH]

    def _text(self, kind: str, content: Mapping[str, Any]) -> str:
        if kind == "weight_on_bit":
            return self._press(float(content["force"]))
        if kind == "drive":
            text = _drive(content)
            self._texts[kind] = text
            return text
        if kind == "configure":
            return self._configure(dict(content["parameters"]))
        if kind == "restore":
            self._weight = None  # the checkpoint has its own
            self._feed.begin(known=False)
            self._texts.clear()
            return f"restore of {content['name']!s:.60}"
        self._texts.clear()
        self._feed.begin(known=True)
        self._parameters = dict(content["parameters"])
        if self._parameters.get("feed_model", "none") == "none":
            self._press(float(self._parameters["weight_on_bit"]))
        else:  # the topic mount has it
            self._weight = None
            self._texts["weight_on_bit"] = "weight on bit by the feed"
        return "a simulation begins"

    def _press(self, weight: float) -> str:
        self._weight = weight
        self._texts["weight_on_bit"] = f"weight on bit {weight:.4g} N"
        return self._texts["weight_on_bit"]

    def _configure(self, parameters: dict[str, Any]) -> str:
        changed = [
            f"{name} {value!s:.30}"
            for name, value in parameters.items()
            if name not in self._parameters or self._parameters[name] != value
        ]
        self._parameters |= parameters
        more = len(changed) - _MOST_NAMES
        text = "parameters: " + ", ".join(changed[:_MOST_NAMES])
        if changed:
            self._texts["configure"] = text
        return (f"{text} and {more} more" if more > 0 else text) if changed else "parameters"


def _drive(content: Mapping[str, Any]) -> str:
    if not content["enabled"]:
        return "drive off"
    voltage, frequency = float(content["voltage"]), float(content["frequency"])
    parts = [f"drive {voltage:.4g} V"]
    if math.isfinite(frequency) and frequency > 0.0:
        parts.append(f"{frequency:.6g} Hz")
    return " at ".join(parts)
