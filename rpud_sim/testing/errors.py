"""Errors of a test with a drill. No ROS, so that the plugin can name them."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from rpud_sim.foundation.quantities import ExpectedError

if TYPE_CHECKING:
    from rpud_sim.verdicts import Verdict


class DrillError(ExpectedError, RuntimeError):
    """A drill that does not start, or has ended; the text has its last lines."""


class LostMessagesError(ExpectedError, AssertionError):
    """Messages that the drill has published and the test has not got."""


class SystemUnderTestError(ExpectedError, AssertionError):
    """A process under test that died, hangs, or answers late: ``kind`` is died, silent or late.

    ``name`` is of the process, or of the topic on which an answer is missing. ``text`` is the whole
    verdict, with the last lines of output.
    """

    def __init__(self, name: str, kind: str, text: str) -> None:
        super().__init__(text)
        self.name = name
        self.kind = kind


class ExpectationFailedError(ExpectedError, AssertionError):
    """Expectations that failed or are undecided, a line for each; and all ``verdicts``."""

    def __init__(self, text: str, verdicts: tuple[Verdict, ...]) -> None:
        super().__init__(text)
        self.verdicts = verdicts


class ExpectationUndecidedError(ExpectedError, RuntimeError):
    """Expectations that are undecided, none of which failed; and all ``verdicts``.

    No assertion failed: it is an error of the test, which has tested nothing.
    """

    def __init__(self, text: str, verdicts: tuple[Verdict, ...]) -> None:
        super().__init__(text)
        self.verdicts = verdicts


def subscribed(topics: tuple[str, ...], hears: tuple[str, ...]) -> tuple[str, ...]:
    """Return the topics of ``subscribes_to``, which 0.3 named ``hears``."""
    if hears:
        warnings.warn("hears is now subscribes_to", DeprecationWarning, stacklevel=3)
    return topics or hears
