"""Run every measurement and write one table as bench/results.json and bench/results.md."""

from __future__ import annotations

import json
import os
import platform
import sys
from pathlib import Path

from bench.measure import MEASUREMENTS
from bench.row import Row
from bench.sweep import sweeps


def main() -> None:
    """Measure, print the table, and write it."""
    rows: list[Row] = []
    for measure in (*MEASUREMENTS, sweeps):
        print(f"measuring: {measure.__doc__}", file=sys.stderr)
        rows.extend(measure())
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    lines = [
        f"Measured on {machine}.",
        "",
        "| figure | median | least | greatest | unit |",
        "|---|---|---|---|---|",
        *(
            f"| {row.name} | {row.median:.3g} | {row.least:.3g} | {row.greatest:.3g} | {row.unit} |"
            for row in rows
        ),
    ]
    folder = Path(__file__).parent
    (folder / "results.md").write_text("\n".join(lines) + "\n")
    content = {"machine": machine, "rows": [row._asdict() for row in rows]}
    (folder / "results.json").write_text(json.dumps(content, indent=2) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
