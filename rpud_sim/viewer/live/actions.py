"""Queue of an operator's actions, and what the drill said to each."""

from __future__ import annotations

import inspect
import re
import threading
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.ros.client import ClientError, DrillClient, RefusedError

# Actions: methods of ``DrillClient``, with the same arguments.
ACTIONS = ("press", "drive", "feed", "engage", "inject", "clear", "pause", "play", "step", "reset")

WAITING, DONE, REFUSED, FAILED = "waiting", "done", "refused", "failed"

_MOST_WAITING = 32
_KEPT = 8  # outcomes besides those that wait
_LONGEST = 200  # characters of the arguments of an outcome
_BEYOND = re.compile(
    r"\w+ = (?P<value>\S+)(?P<unit> .+?)? is outside its range "
    r"[\[(](?P<low>\S+), (?P<high>\S+)[\])](?P=unit)?"
)


@dataclass(frozen=True)
class Outcome:
    """Action of the operator, and what the drill said to it."""

    number: int  # of the action, from 1 on
    name: str  # such as ``press``
    arguments: str  # as they were given
    state: str  # ``waiting``, ``done``, ``refused`` or ``failed`` (no drill, or no answer)
    text: str  # the reason, or a result such as ``fault 3``


def plain_refusal(reason: str) -> str:
    """Return a drill's reason in fewer words, such as ``9999 V is above 200 V``."""
    found = _BEYOND.fullmatch(reason)
    if found is None:
        return reason
    value, low, high, unit = (found[name] or "" for name in ("value", "low", "high", "unit"))
    try:
        if float(value) < float(low):
            return f"{value}{unit} is below {low}{unit}"
        return f"{value}{unit} is above {high}{unit}" if float(value) > float(high) else reason
    except ValueError:
        return reason


class InterruptedWaitError(Exception):
    """Raised inside a wait of the client to end it."""


class Actions:
    """Actions in the order in which they were asked for; any thread may ask."""

    def __init__(self) -> None:
        self.running = ""  # name of the action that is under way; empty for none
        self._lock = threading.Lock()
        self._queue: deque[tuple[int, str, dict[str, Any]]] = deque()
        self._outcomes: dict[int, Outcome] = {}
        self._numbers = 0

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """Of the latest actions, oldest first."""
        with self._lock:
            return tuple(self._outcomes.values())

    def add(self, name: str, arguments: dict[str, Any]) -> int:
        """Queue an action and return its number; one that does not exist is a ParameterError."""
        if name not in ACTIONS:
            raise ParameterError(f"action {shown(name)} is unknown; {did_you_mean(name, ACTIONS)}")
        try:
            inspect.signature(getattr(DrillClient, name)).bind(None, **arguments)
        except TypeError as error:
            raise ParameterError(f"action {name}: {error}") from None
        with self._lock:
            self._numbers += 1
            number = self._numbers
            state, text = WAITING, ""
            if len(self._queue) < _MOST_WAITING:
                self._queue.append((number, name, dict(arguments)))
            else:
                state, text = FAILED, f"{_MOST_WAITING} actions wait already"
            said = ", ".join(f"{key} {value}" for key, value in arguments.items() if value != "")
            self._note(Outcome(number, name, said[:_LONGEST], state, text))
        return number

    def waits_for(self, names: Collection[str]) -> bool:
        with self._lock:
            return any(name in names for _, name, _ in self._queue)

    def execute(self, client: DrillClient) -> bool:
        """Execute the next action; return whether there was one."""
        action = self._next()
        if action is None:
            return False
        number, name, arguments = action
        self.running = name
        try:
            result = getattr(client, name)(**arguments)
        except (RefusedError, ParameterError) as error:
            self._settle(number, REFUSED, plain_refusal(str(error)))
        except ClientError as error:
            self._settle(number, FAILED, str(error))
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            # No page asks so; but the thread that hears the drill must not end by it.
            self._settle(number, REFUSED, f"wrong arguments: {error}")
        except InterruptedWaitError:
            self._settle(number, FAILED, "interrupted")
        else:
            self._settle(number, DONE, _result_text(name, result))
        finally:
            self.running = ""
        return True

    def fail_all(self, reason: str) -> None:
        """Let all actions that wait fail for a reason."""
        while (action := self._next()) is not None:
            self._settle(action[0], FAILED, reason)

    def _next(self) -> tuple[int, str, dict[str, Any]] | None:
        with self._lock:
            return self._queue.popleft() if self._queue else None

    def _settle(self, number: int, state: str, text: str) -> None:
        with self._lock:
            self._note(replace(self._outcomes[number], state=state, text=text))

    def _note(self, outcome: Outcome) -> None:
        self._outcomes[outcome.number] = outcome
        settled = [each.number for each in self._outcomes.values() if each.state != WAITING]
        for number in settled[:-_KEPT]:
            del self._outcomes[number]


def _result_text(name: str, result: Any) -> str:
    if name == "inject":
        return f"fault {result}"
    if name == "clear":
        return f"ended: {', '.join(map(str, result)) or 'none'}"
    return ""
