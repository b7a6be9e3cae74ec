"""Run a command while busy loops take the processors from it: `make test-busy`.

`python tools/busy.py -- COMMAND` gives the command's exit code. The kernel kills each
loop with this process, whatever ends that.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from contextlib import ExitStack

from rpud_sim.foundation.child_process import end_with_parent


def main() -> int:
    """Start the loops, run the command, end the loops."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    one_each = len(os.sched_getaffinity(0))
    parser.add_argument("--loops", type=int, default=one_each, help="one for each processor")
    parser.add_argument("command", nargs="+", help="what runs beside them")
    arguments = parser.parse_args()
    with ExitStack() as stack:
        for _ in range(arguments.loops):
            spin = [sys.executable, "-c", "while True: pass"]
            loop = subprocess.Popen(spin, preexec_fn=end_with_parent)
            stack.callback(loop.wait)
            stack.callback(loop.kill)
        return subprocess.run(arguments.command, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
