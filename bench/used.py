"""Run a command, and write its usage as JSON to a file when it ends.

``python -m bench.used FILE COMMAND...`` writes processor time and wall time [s], the peak of memory
[bytes] and the exit code. A process inherits the peak of the one that starts it: this one is small.
"""

import json
import os
import subprocess
import sys
import time


def main(file: str, command: list[str]) -> None:
    """Run the command with this process's streams, and end with it if it is interrupted."""
    began = time.perf_counter()
    process = subprocess.Popen(command)
    try:
        _, status, usage = os.wait4(process.pid, 0)
    except BaseException:
        process.kill()
        raise
    found = {
        "processor": usage.ru_utime + usage.ru_stime,
        "wall": time.perf_counter() - began,
        "memory": usage.ru_maxrss * 1024,
        "code": os.waitstatus_to_exitcode(status),
    }
    with open(file, "w", encoding="utf-8") as out:
        json.dump(found, out)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
