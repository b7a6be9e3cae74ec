"""``python -m validation``: write docs/explanation/validation.md and its tables."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from rpud_sim.foundation.atomic_folder import write_atomic
from validation.page import FILES, page
from validation.scores import Effort, run_validation

PAGE = Path(__file__).resolve().parents[1] / "docs" / "explanation" / "validation.md"

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=PAGE, help="default: %(default)s")
    file = parser.parse_args().file
    started = time.perf_counter()
    results = run_validation(Effort())
    file.with_suffix("").mkdir(exist_ok=True)
    for name, (_, make) in FILES.items():
        write_atomic(file.with_suffix("") / f"{name}.csv", make(results).csv())
    write_atomic(file, page(results))
    print(f"{file} written in {time.perf_counter() - started:.0f} s")
