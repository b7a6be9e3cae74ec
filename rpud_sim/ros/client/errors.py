"""Errors of a client; the text of each is one line."""

from __future__ import annotations


class ClientError(RuntimeError):
    """A command that did not succeed."""


class RefusedError(ClientError):
    """Command or request that the drill refused; the text is the drill's own reason.

    ``result`` is the number of ``rpud_msgs/Result``; None where there is none.
    """

    def __init__(self, reason: str, result: int | None = None) -> None:
        super().__init__(reason)
        self.result = result


class NoDrillError(ClientError):
    """No drill in the namespace, or more than one."""


class NoAnswerError(ClientError, TimeoutError):
    """Nothing came within the time limit."""
