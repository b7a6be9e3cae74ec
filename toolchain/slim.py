"""Make a virtual environment smaller: `make` calls it after each installation.

Wheels hold no links, so that ROS's libraries and those that they bring come several times. Here
equal files become one. Tests of libraries, which nothing here runs, go.
"""

from __future__ import annotations

import filecmp
import os
import shutil
import sys
from collections import defaultdict
from pathlib import Path

_LEAST = 1 << 16  # size of files that are worth a comparison [bytes]
_TESTED = ("numba", "numpy", "pandas", "pyarrow", "scipy")


def link_equal_files(folder: Path) -> None:
    """Make files of libraries with equal content one file with several names.

    Python's caches stay as they are: another process, which builds the messages meanwhile, writes
    them under names that vanish. So does npm, beside the libraries.
    """
    by_size = defaultdict[int, list[Path]](list)
    for place, folders, names in os.walk(folder / "lib"):
        folders[:] = [name for name in folders if name != "__pycache__"]
        for path in (Path(place, name) for name in names):
            if not path.is_symlink() and (size := path.stat().st_size) >= _LEAST:
                by_size[size].append(path)
    for paths in by_size.values():
        kept: list[Path] = []
        for path in sorted(paths):
            same = (each for each in kept if filecmp.cmp(each, path, shallow=False))
            if (first := next(same, None)) is None:
                kept.append(path)
            elif not first.samefile(path):
                link = path.with_name(f".{path.name}.link")
                link.hardlink_to(first)
                link.replace(path)


def remove_tests(folder: Path) -> None:
    """Remove the tests of large libraries."""
    for library in _TESTED:
        for tests in [*folder.glob(f"lib/python3*/site-packages/{library}/**/tests")]:
            shutil.rmtree(tests, ignore_errors=True)


if __name__ == "__main__":
    remove_tests(Path(sys.argv[1]))
    link_equal_files(Path(sys.argv[1]))
