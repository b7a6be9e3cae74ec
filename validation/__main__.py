"""``python -m validation``: write docs/explanation/validation.md and its tables."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from rpud_sim.cli.program import progress_bar
from rpud_sim.foundation.whole_folder import whole_file
from validation.page import page
from validation.results import Effort, run_validation
from validation.tables import FILES

PAGE = Path(__file__).resolve().parents[1] / "docs" / "explanation" / "validation.md"


def main() -> None:
    """Run every simulation and write the page."""
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=PAGE, help="default: %(default)s")
    file = parser.parse_args().file
    started = time.perf_counter()
    results = run_validation(Effort(), _track)
    tables = file.with_suffix("")
    tables.mkdir(exist_ok=True)
    texts = {tables / f"{name}.csv": make(results).csv() for name, (_, make) in FILES.items()}
    for path, text in {**texts, file: page(results)}.items():
        with whole_file(path) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
    print(f"{file} written in {time.perf_counter() - started:.0f} s")


def _track(items: Iterable[Any], total: int, title: str) -> Iterator[Any]:
    with progress_bar("it", total, title=title) as bar:
        for item in items:
            yield item
            bar.update()


if __name__ == "__main__":
    main()
