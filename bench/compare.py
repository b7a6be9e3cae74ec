"""What became slower or faster than another commit: `python -m bench.compare BASE [WORK ...]`.

Both run the same commands in the order A B B A, each in a process of its own. Times are the
processor's. The exit code is 1 if the whole interval of something is above the threshold.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from bench.command import RPUD, run
from bench.page import KEPT, ROOT

NEGLIGIBLE = 0.02
"""Smaller differences come from the place of files and memory: copies of one version have them."""
FEWEST = 3
"""Pairs that an interval needs."""

_SEARCH_PATHS = ("PATH", "PYTHONPATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH")
_WEIGHTS = f"weight_on_bit={','.join(map(str, range(5, 25)))}"
_DRILL = (*RPUD, "simulate", "--regime", "drilling", "--duration")


def works(given: Path, out: Path) -> dict[str, Sequence[str | Path]]:
    """Return the words of each work, from the folder of the inputs and one for what it writes."""
    return {
        "simulate": (*_DRILL, "300"),
        "simulate --bag": (*_DRILL, "20", "--bag", out / "bag"),
        "verify": (*RPUD, "verify", given / "bag"),
        "export": (*RPUD, "export", given / "bag", "--out", out / "tables"),
        "report": (*RPUD, "report", given / "bag", "--out", out / "report.html"),
        "info": (*RPUD, "info", given / "bag"),
        "sweep": (*RPUD, "sweep", "--set", _WEIGHTS, "--seeds", "100", "--out", out / "sweep.csv"),
    }


WORKS = tuple(works(Path(), Path()))


class Ratio(NamedTuple):
    """Time of the work tree over that of the base."""

    value: float  # geometric mean over the pairs
    low: float  # ends of the interval, by Student's t on the logarithms of the pairs' ratios
    high: float

    def __str__(self) -> str:
        """Return the verdict in one line."""
        faster = "faster" if self.high < 1.0 / (1.0 + NEGLIGIBLE) else "no difference seen"
        verdict = "slower" if self.low > 1.0 + NEGLIGIBLE else faster
        return f"{verdict}: {self.value:.3f} times the time ({self.low:.3f} to {self.high:.3f})"


def ratio(pairs: Sequence[tuple[float, float]], comparisons: int = 1) -> Ratio:
    """Return the ratio of second to first times; all intervals hold at once with 95 %."""
    logarithms = np.log([second / first for first, second in pairs])
    mean = float(logarithms.mean())
    error = float(logarithms.std(ddof=1)) / math.sqrt(len(pairs))
    reach = float(stdtrit(len(pairs) - 1, 1.0 - 0.025 / comparisons)) * error  # Bonferroni
    return Ratio(math.exp(mean), math.exp(mean - reach), math.exp(mean + reach))


def checkout(commit: str) -> Path:
    """Return a folder with the sources of a commit, kept so that its kernels compile only once."""
    words = ("git", "-C", str(ROOT))
    verify = (*words, "rev-parse", "--verify", "--end-of-options", f"{commit}^{{commit}}")
    found = subprocess.run(verify, capture_output=True, text=True, check=False)
    if found.returncode:
        raise SystemExit(f"bench: commit {commit} is not in this clone, which may be a shallow one")
    tree = KEPT / "checkouts" / found.stdout.strip()
    if not tree.is_dir():
        archive = subprocess.run([*words, "archive", tree.name], capture_output=True, check=True)
        tree.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(dir=tree.parent))
        subprocess.run(["tar", "-x", "-C", str(part)], input=archive.stdout, check=True)
        part.rename(tree)
    return tree


def environment(tree: Path) -> dict[str, str]:
    """Return this process's variables, with search paths that lead to one version only."""
    made = {**os.environ, "XDG_CACHE_HOME": str(KEPT / "cache" / tree.name)}
    for name in _SEARCH_PATHS:
        entries = [Path(entry) for entry in made.get(name, "").split(os.pathsep) if entry]
        ours = {each for each in entries if each.is_relative_to(ROOT)}
        kept = [e for e in entries if e not in ours or e.is_relative_to(ROOT / ".venv")]
        made[name] = os.pathsep.join(map(str, [tree, *kept] if name == "PYTHONPATH" else kept))
    return made


def compare(trees: tuple[Path, Path], names: Sequence[str], pairs: int) -> dict[str, Ratio]:
    """Return the ratio of the second tree's time to the first's, for each work."""
    environments = [environment(tree) for tree in trees]
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder, "given"), Path(folder, "out")
        run(works(given, given)["simulate --bag"], environments[0])  # a later version can read it
        for turn in range(-1, pairs):  # the first one compiles
            for name in names:
                took = [0.0, 0.0]
                for each in (0, 1) if turn % 2 == 0 else (1, 0):
                    out.mkdir()
                    took[each] = run(works(given, out)[name], environments[each]).processor
                    shutil.rmtree(out)
                if turn >= 0:
                    times[name].append((took[0], took[1]))
            print(f"turn {turn + 1} of {pairs} is done", file=sys.stderr, flush=True)
    return {name: ratio(found, len(names)) for name, found in times.items()}


def main() -> int:
    """Compare, print the verdicts, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench.compare", description=__doc__)
    parser.add_argument("base", help="commit to compare the work tree with")
    parser.add_argument("names", nargs="*", metavar="WORK", help=f"of {', '.join(WORKS)}")
    parser.add_argument("--pairs", type=int, default=8, help="runs of both (%(default)d)")
    parser.add_argument("--threshold", type=float, default=10.0, help="in percent (%(default)g)")
    arguments = parser.parse_args()
    if unknown := {*arguments.names} - {*WORKS}:
        parser.error(f"there is no {', '.join(sorted(unknown))}; there is {', '.join(WORKS)}")
    if arguments.pairs < FEWEST:
        parser.error(f"--pairs is {arguments.pairs}; it must be at least {FEWEST}")
    trees = checkout(arguments.base), ROOT
    ratios = compare(trees, arguments.names or list(WORKS), arguments.pairs)
    print(*(f"{name}: {found}" for name, found in ratios.items()), sep="\n")
    return int(any(each.low > 1.0 + arguments.threshold / 100.0 for each in ratios.values()))


if __name__ == "__main__":
    sys.exit(main())
