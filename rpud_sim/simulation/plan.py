"""Plan of a run: its beginning and its changes. Equal plans give equal bits."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.options import SEED_OR_NONE
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import error_text
from rpud_sim.simulation.changes import Change, ChangeError, Inject, action_of, whole_time
from rpud_sim.simulation.commands import COMMAND_NAMES
from rpud_sim.simulation.configuration import Settings, to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.scenario_file import read_scenario
from rpud_sim.simulation.versions import ENGINE, engine_versions


@dataclass(frozen=True)
class JournalEntry:
    """Entry of a journal: one change from outside."""

    sequence: int  # counts the entries from zero
    time: int  # simulation time of the change [ns]
    kind: str  # one of the KIND constants of ``rpud_msgs/JournalEntry``
    content: Mapping[str, Any]  # details of the kind, by name

    @property
    def text(self) -> str:
        return json_text({"time": self.time, **self.content})


# Entries after which an entry ``begin`` contains its strata again: a drill keeps so many entries
# more than it promises, so that it always has the strata of those.
STRATA_REACH = 100_000
_SHORT_STRATA = 1000  # characters that each ``begin`` contains, a third of its other parameters


def strata_entry(content: Any) -> int | None:
    """Return the number of the entry with the strata of a ``begin``; None if it contains them."""
    match content:
        case {"parameters": {"strata": {"same_as_entry": int(number)}}}:
            return number
    return None


class StrataTexts:
    """Strata of the runs of a journal: a long text is in one entry, to which later ones refer.

    It gets the content of each entry ``begin``, in order.
    """

    def __init__(self) -> None:
        self._number = -1  # of the entry that contains the strata of the latest run
        self._text = ""

    def shorten(self, number: int, content: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the content of an entry, without strata that the run before had, too."""
        text = content["parameters"]["strata"]
        near = number - self._number < STRATA_REACH
        if text == self._text and len(text) > _SHORT_STRATA and near:
            return _with_strata(content, {"same_as_entry": self._number})
        self._number, self._text = number, text
        return content

    def complete(self, number: int, content: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the content of an entry with its strata, the inverse of ``shorten``.

        If the entry that contains them did not come, raise a ChangeError.
        """
        other = strata_entry(content)
        if other is None:
            match content:
                case {"parameters": {"strata": str(text)}}:
                    self._number, self._text = number, text
            return content
        if other != self._number:
            raise ChangeError(f"journal entry {number} has the strata of entry {other}: missing")
        return _with_strata(content, self._text)


def _with_strata(content: Mapping[str, Any], strata: Any) -> Mapping[str, Any]:
    return {**content, "parameters": {**content["parameters"], "strata": strata}}


class Journal:
    """Queue of the entries of runs, in order.

    Commands of one time have a fixed order, whichever arrived first: weight on bit, drive, feed and
    mount do not depend on each other.
    """

    def __init__(self, first: int = 0) -> None:
        self.count = first  # number of the next entry that ``drain`` returns; read-only
        self._waiting: list[tuple[int, str, Mapping[str, Any]]] = []  # time, kind and content
        self._strata = StrataTexts()

    def record(self, time: int, kind: str, content: Mapping[str, Any]) -> None:
        """Append an entry for a change at a simulation time [ns]."""
        if kind == "origin" and self._waiting and self._waiting[-1][:2] == (time, kind):
            self._waiting.pop()  # nothing was published under it
        self._waiting.append((time, kind, content))

    def drain(self) -> list[JournalEntry]:
        """Return the entries since the last call."""
        entries = []
        for (_, commanded), group in groupby(self._waiting, _time_and_whether_commanded):
            for time, kind, content in sorted(group, key=_place) if commanded else group:
                if kind == "begin":
                    content = self._strata.shorten(self.count, content)
                entries.append(JournalEntry(self.count, time, kind, content))
                self.count += 1
        self._waiting.clear()
        return entries


# Scenario files had larger seeds.
_KEPT_SEED = Quantity("", "a seed", 0.0, 2.0**63, below=True, whole=True)

_COMMANDS = tuple(COMMAND_NAMES.values())


def _time_and_whether_commanded(entry: tuple[int, str, object]) -> tuple[int, bool]:
    time, kind, _ = entry
    return time, kind in _COMMANDS


def _place(entry: tuple[int, str, object]) -> int:
    return _COMMANDS.index(entry[1])


_UNUSABLE = (ArithmeticError, LookupError, TypeError, ValueError)


def initial_phases(repeat: int, seed: int | None) -> tuple[float, ...]:
    """Return an ensemble's phases [cycles]: drawn with the seed; zero for one run without."""
    if seed is None and repeat == 1:
        return (0.0,)
    return tuple(np.random.default_rng(seed or 0).random(repeat).tolist())


@dataclasses.dataclass(frozen=True)
class Beginning:
    """Beginning of a run."""

    settings: Settings  # all parameters
    initial_phase: float = 0.0  # phase of the vibration at time zero [cycles]
    seed: int = 0  # seed of the noise of faulty signals
    # faults that begin by themselves, with all values drawn, in the order of their times
    faults: tuple[Change, ...] = ()

    @staticmethod
    def drawn(settings: Settings, seed: int | None = None) -> Beginning:
        """Return the beginning that a seed draws: a given seed, else the seed of the settings.

        Each may be ``NO_SEED``.

        It draws the initial phase, the values of the scenario and the noise of faulty signals.
        Without one the phase is zero, the scenario has its own, and the noise is as with seed 0.
        """
        if seed is not None:
            seed = int(SEED_OR_NONE.check("seed", seed))
            settings = dataclasses.replace(settings, seed=seed)
        seed = settings.seed_or_none
        [phase] = initial_phases(1, seed)
        faults = read_scenario(settings.scenario, seed) if settings.scenario else ()
        return Beginning(settings, phase, seed or 0, faults)

    def to_journal(self) -> dict[str, Any]:
        """Return the content of a journal's entry ``begin``."""
        return {
            "parameters": self.settings.values(),
            "initial_phase": self.initial_phase,
            "seed": self.seed,
            "faults": [_fault_content(change) for change in self.faults],
            "engine": ENGINE,
            "made_by": engine_versions(),
        }

    @staticmethod
    def from_journal(content: Mapping[str, Any]) -> Beginning:
        """Return the beginning of a journal's entry ``begin``, the inverse of ``to_journal``.

        Raises:
            ArithmeticError, LookupError, TypeError, ValueError: if the content is unusable.
        """
        faults = []
        for planned in content["faults"]:
            onset, clear = whole_time(planned["onset"]), planned["clear"]
            fault = Fault(planned["kind"], planned["channel"], planned["magnitude"])
            duration = 0 if clear is None else whole_time(clear - onset)
            faults.append(Change(onset, Inject(fault, duration)))
        return Beginning(
            to_settings(content["parameters"]),
            float(content["initial_phase"]),
            int(_KEPT_SEED.check("seed", content["seed"])),
            tuple(faults),
        )


def _fault_content(change: Change) -> dict[str, Any]:
    assert isinstance(change.action, Inject)
    duration = change.action.duration
    clear = change.time + duration if duration else None
    return {**vars(change.action.fault), "onset": change.time, "clear": clear}


@dataclasses.dataclass(frozen=True)
class Plan:
    """Beginning of a run and its changes."""

    beginning: Beginning
    changes: tuple[Change, ...] = ()  # changes in the order of their times
    recorded: bool = False  # whether they took effect before, as in a journal
    # simulation time up to which a drill node computes it, before it continues live [ns]
    live_from: int = 0

    @staticmethod
    def of(entries: Iterable[JournalEntry]) -> Plan:
        """Return the plan that entries of a journal carry out; the first one begins the run.

        An unusable entry raises a ChangeError.
        """
        beginning: Beginning | None = None
        changes: list[Change] = []
        for entry in entries:
            place = f"journal entry {entry.sequence} ({entry.kind:.20}) cannot be done: "
            try:
                if beginning is None:
                    if entry.kind != "begin":
                        raise ValueError("nothing has begun")
                    beginning = Beginning.from_journal(entry.content)
                    continue
                if changes and entry.time < changes[-1].time:
                    before = f"its time {entry.time} ns is before the previous entry's time"
                    raise ValueError(before)
                changes.append(Change(entry.time, action_of(entry.kind, entry.content), place))
            except _UNUSABLE as error:
                raise ChangeError(f"{place}{error_text(error)}") from error
        if beginning is None:
            raise ChangeError("nothing has begun")
        return Plan(beginning, tuple(changes), recorded=True)
