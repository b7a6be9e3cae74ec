"""Run a command while busy loops take the processors from it: `make test-busy`.

`python tools/busy.py --loops 4 -- COMMAND` gives the command's exit code. The kernel kills each
loop with this process, whatever ends that.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from contextlib import ExitStack

_PR_SET_PDEATHSIG = 1


def main() -> int:
    """Start the loops, run the command, end the loops."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument("--loops", type=int, default=4, help="busy loops (default: %(default)s)")
    parser.add_argument("command", nargs="+", help="what runs beside them")
    arguments = parser.parse_args()
    with ExitStack() as stack:
        for _ in range(arguments.loops):
            loop = subprocess.Popen([sys.executable, "-c", _loop(os.getpid())])
            stack.callback(loop.wait)
            stack.callback(loop.kill)
        return subprocess.run(arguments.command, check=False).returncode


def _loop(parent: int) -> str:
    """Return a program that spins, and dies with its parent."""
    return (
        "import ctypes, os\n"
        f"ctypes.CDLL(None).prctl({_PR_SET_PDEATHSIG}, {int(signal.SIGKILL)})\n"
        f"while os.getppid() == {parent}:\n"
        "    pass\n"
    )


if __name__ == "__main__":
    sys.exit(main())
