"""Server of the live page in a process of its own, so that no page can make the drill late."""

from __future__ import annotations

import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rpud_sim.cli.program import CommandError
from rpud_sim.foundation.terminal import complain

if TYPE_CHECKING:
    from rpud_sim.ros.stopping import StopRequest

_PROGRAM = "rpud run"
_START_TIMEOUT = 60.0  # on a busy machine [s]
_CLOSE_TIMEOUT = 10.0  # s
_POLL_PERIOD = 0.05  # between looks at a request to stop [s]


@contextmanager
def watching(port: int | None, namespace: str, stop: StopRequest) -> Iterator[None]:
    """Serve the page of a drill meanwhile, and print its address; without a port, no page."""
    if port is None:
        yield
        return
    command = [
        *(sys.executable, "-m", "rpud_sim.cli.main", "watch", "--port", str(port)),
        *("--namespace", namespace, "--until-eof"),
    ]
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,  # it ends with this process, whatever ends that
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="backslashreplace",
        # Ctrl-C must stop the drill first.
        start_new_session=True,
    ) as process:
        try:
            _announce(process, stop)
            yield
            if process.poll() is not None and not stop.requested:
                complain(_PROGRAM, "the server of the page ended before the drill")
        finally:
            process.terminate()
            try:
                process.communicate(timeout=_CLOSE_TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()


def _announce(process: subprocess.Popen[str], stop: StopRequest) -> None:
    """Wait for the server's first line, and print it."""
    assert process.stdout is not None  # it is a pipe
    assert process.stderr is not None
    end = time.monotonic() + _START_TIMEOUT
    while time.monotonic() < end and not stop.requested:
        readable, _, _ = select.select([process.stdout], [], [], _POLL_PERIOD)
        if readable:
            line = process.stdout.readline()
            if line:
                print(line, end="", flush=True)
                return
            reason = process.stderr.read().strip().splitlines()
            text = reason[-1].removeprefix("rpud watch: ") if reason else "it ended"
            raise CommandError(f"the page cannot be served: {text}")
    if not stop.requested:
        raise CommandError(f"the page cannot be served: nothing within {_START_TIMEOUT:g} s")
