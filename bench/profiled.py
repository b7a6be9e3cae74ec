"""Run a program, and write the processor time that each file of Python took, of all threads.

    python -m bench.profiled OUT AFTER MODULE:FUNCTION ARGUMENTS...

Counting begins some seconds after the start [s]. What a file calls of compiled code counts as its
own. Threads without Python, such as those of the middleware, are one entry.
"""

from __future__ import annotations

import cProfile
import importlib
import json
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from types import CodeType

OTHERS = "other threads"


class Profiler:
    """Profiles every thread that Python starts from now on, and the present one.

    Args:
        after: time until counting begins [s].
    """

    def __init__(self, after: float) -> None:
        self._profiles: list[cProfile.Profile] = []
        self._before: Counter[str] = Counter()
        self._used = 0.0
        threading.setprofile(lambda *_: self._begin())
        self._begin()
        timer = threading.Timer(after, self._count)
        timer.daemon = True
        timer.start()

    def end(self) -> Counter[str]:
        """Return the time by file since counting began [s]."""
        sys.setprofile(None)
        spent = self._spent()
        spent.subtract(self._before)
        spent[OTHERS] = time.process_time() - self._used - sum(spent.values())
        return Counter({file: seconds for file, seconds in spent.items() if seconds > 0.0})

    def _begin(self) -> None:
        profile = cProfile.Profile(time.thread_time, builtins=False)
        self._profiles.append(profile)
        profile.enable()

    def _count(self) -> None:
        self._before, self._used = self._spent(), time.process_time()

    def _spent(self) -> Counter[str]:
        spent: Counter[str] = Counter()
        for profile in list(self._profiles):
            for entry in profile.getstats():
                if isinstance(entry.code, CodeType):
                    spent[entry.code.co_filename] += entry.inlinetime
        return spent


def main() -> None:
    """Run the program under the profiler."""
    out, after, entry, *arguments = sys.argv[1:]
    sys.argv = [entry, *arguments]
    module, _, function = entry.partition(":")
    profiler = Profiler(float(after))
    try:
        getattr(importlib.import_module(module), function)()
    finally:
        Path(out).write_text(json.dumps(profiler.end()))


if __name__ == "__main__":
    main()
