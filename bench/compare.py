"""What became slower or faster than another commit: `python -m bench.compare BASE [WORK ...]`.

Both run the same commands in the order A B B A, each in a separate process. Times are the
processor's. The exit code is 1 if the whole interval of something is above the threshold.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from bench.command import RPUD, run
from bench.table import ROOT

KEPT = ROOT / "build/bench"
NEGLIGIBLE = 0.02
"""Smaller differences come from the place of files and memory: copies of one version have them."""
_SEARCH_PATHS = ("PATH", "PYTHONPATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH")
_DRILL = (*RPUD, "simulate", "--regime", "drilling", "--duration")
WORKS = {  # {bag} is made before, {out} is a new folder
    "simulate": (*_DRILL, "300"),
    "simulate of the paper's tables": (
        *_DRILL,
        "300",
        "--config",
        str(ROOT / "config/tables_drilling.yaml"),
    ),
    "simulate --bag": (*_DRILL, "20", "--bag", "{out}/bag"),
    "ensemble": (*_DRILL, "2", "--repeat", "400"),
    "verify": (*RPUD, "verify", "{bag}"),
    "export": (*RPUD, "export", "{bag}", "--out", "{out}/tables"),
    "report": (*RPUD, "report", "{bag}", "--out", "{out}/report.html"),
    "info": (*RPUD, "info", "{bag}"),
}


def ratio(pairs: Sequence[tuple[float, float]], comparisons: int = 1) -> tuple[float, float, float]:
    """Return second over first times (geometric mean), and the ends of its interval.

    By Student's t on the logarithms; all intervals hold together with 95 % (Bonferroni).
    """
    logarithms = np.log([second / first for first, second in pairs])
    reach = stats.sem(logarithms) * stats.t.ppf(1.0 - 0.025 / comparisons, len(pairs) - 1)
    mean = logarithms.mean()
    low, middle, high = (float(each) for each in np.exp([mean - reach, mean, mean + reach]))
    return middle, low, high


def verdict(middle: float, low: float, high: float) -> str:
    """Return a ratio in one line."""
    faster = "faster" if high < 1.0 / (1.0 + NEGLIGIBLE) else "no difference seen"
    word = "slower" if low > 1.0 + NEGLIGIBLE else faster
    return f"{word}: {middle:.3f} times the time ({low:.3f} to {high:.3f})"


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


def compare(
    trees: tuple[Path, Path], names: Sequence[str], pairs: int
) -> dict[str, list[tuple[float, float]]]:
    """Return pairs of the times of both trees, for each work."""
    environments = [environment(tree) for tree in trees]
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    with tempfile.TemporaryDirectory() as folder:
        bag, out = Path(folder, "given", "bag"), Path(folder, "out")

        def took(name: str, which: int) -> float:
            out.mkdir()
            words = [str(word).format(bag=bag, out=out) for word in WORKS[name]]
            used = run(words, environments[which]).processor
            shutil.rmtree(out)
            return used

        run((*_DRILL, "20", "--bag", bag), environments[0])  # a later version can read it
        for turn in range(-1, pairs):  # the first one compiles
            for name in names:
                order = (0, 1) if turn % 2 == 0 else (1, 0)
                found = {which: took(name, which) for which in order}
                if turn >= 0:
                    times[name].append((found[0], found[1]))
            print(f"turn {turn + 1} of {pairs} is done", file=sys.stderr, flush=True)
    return times


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
    if arguments.pairs < 3:
        parser.error(f"--pairs is {arguments.pairs}; an interval needs at least 3")
    names = arguments.names or list(WORKS)
    found = compare((checkout(arguments.base), ROOT), names, arguments.pairs)
    ratios = {name: ratio(pairs, len(found)) for name, pairs in found.items()}
    print(*(f"{name}: {verdict(*each)}" for name, each in ratios.items()), sep="\n")
    return int(any(low > 1.0 + arguments.threshold / 100.0 for _, low, _ in ratios.values()))


if __name__ == "__main__":
    sys.exit(main())
