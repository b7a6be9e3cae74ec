"""Breaks the supervisor in twenty ways, and shows which requirements catch each of the mutants.

    python examples/mutants.py [--jobs N] [--first] [NAME ...]

A requirement that catches no mutant, and a mutant that no requirement catches, show what the tests
do not look at. It runs ``test_supervisor.py`` as it is: this file is also a plugin of pytest that
gives it the mutants instead of the supervisor. The exit code is 1 if a mutant survives.
"""

import argparse
import collections
import importlib.util
import os
import sys
import tempfile
import time
from pathlib import Path

import pytest

from rpud_sim.testing.errors import SystemUnderTestError

FOLDER = Path(__file__).resolve().parent
TESTS = FOLDER / "test_supervisor.py"

# What is wrong, which text of supervisor.py it replaces, and the new text.
MUTANTS = {
    "never engages": ("self._request(True, State.RAMPING, now)", "self._command(now)"),
    "wrong target": ('"target", 35.0', '"target", 30.0'),
    "sign error": ("self._target - force", "force - self._target"),
    "ramps too fast": ("LARGEST_STEP = 2.0", "LARGEST_STEP = 3.0"),
    "ramps too slowly": ("LARGEST_STEP = 2.0", "LARGEST_STEP = 0.5"),
    "presses too hard": ("GREATEST_WEIGHT = 40.0", "GREATEST_WEIGHT = 100.0"),
    "no retreat": ("now - max(self._struck, self._driven) > SILENCE", "False"),
    "late reaction": ("SILENCE = 300_000_000", "SILENCE = 600_000_000"),
    "nervous": ("SILENCE = 300_000_000", "SILENCE = 5_000_000"),
    "drive stays on": ("in (State.RAMPING, State.DRILLING)", "is not State.READY"),
    "weight stays on": ("self._weight = 0.0\n        self._change", "self._change"),
    "stays in the rock": ("self._request(False, State.RETREATED, now)", "self._command(now)"),
    "presses after the retreat": ("if self._state is not State.RETREATED:", "if True:"),
    "trusts a stuck sensor": ("len(set(forces)) < 2", "not forces"),
    "trusts garbage": ("abs(force) <= GREATEST_FORCE", "True"),
    "uses stale data": ("if taken > end - PERIOD:", "if True:"),
    "blind for too long": ("BLINDNESS = 200_000_000", "BLINDNESS = 800_000_000"),
    "distrusts a good sensor": ("GREATEST_FORCE = 500.0", "GREATEST_FORCE = 40.0"),
    "dies of NaN": ("message.force))", "int(message.force)))"),
    "commands too seldom": ("PERIOD = 100_000_000", "PERIOD = 200_000_000"),
}

# Variables for the processes of pytest: folder of the mutants; whether one catch is enough.
FILES, FIRST = "SUPERVISOR_MUTANTS", "SUPERVISOR_FIRST_CATCH"
CAUGHT = "caught by"  # name of the properties in the reports of tests
DONE = pytest.StashKey()  # mutants that need no further run
ANSWER = "REQ-08"  # is broken by a supervisor that dies or does not answer


def write_mutants(folder, names):
    """Write the mutants of some names; each text to replace occurs once in the supervisor."""
    source = (FOLDER / "supervisor.py").read_text()
    for name in names:
        old, new = MUTANTS[name]
        if source.count(old) != 1:
            raise ValueError(f"{name}: {old!r} occurs {source.count(old)} times in supervisor.py")
        (folder / f"{name}.py").write_text(source.replace(old, new))


# The plugin, in each process of pytest.


def pytest_generate_tests(metafunc):
    """Give each test the mutants instead of the supervisor."""
    if "supervisor" in metafunc.fixturenames:
        paths = sorted(Path(os.environ[FILES]).glob("*.py"))
        marks = [pytest.mark.xdist_group(path.stem) for path in paths]
        mutants = [pytest.param(each, marks=mark) for each, mark in zip(paths, marks, strict=True)]
        metafunc.parametrize("supervisor", mutants, ids=[path.stem for path in paths])


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item, call):
    """Note what has caught a mutant; one that does not answer takes long in every run."""
    report = (yield).get_result()
    if call.when != "call" or "supervisor" not in item.fixturenames:
        return
    mutant = item.callspec.params["supervisor"].stem
    error = call.excinfo.value if call.excinfo else None
    verdicts = getattr(error, "verdicts", ())
    caught = [each.requirement for each in verdicts if each.outcome == "failed"]
    if isinstance(error, SystemUnderTestError):
        caught = [ANSWER]
    if isinstance(error, SystemUnderTestError) or (caught and FIRST in os.environ):
        item.config.stash.setdefault(DONE, set()).add(mutant)
    report.user_properties.append((CAUGHT, (mutant, caught, call.duration, str(error or ""))))


def pytest_runtest_setup(item):
    """Skip further runs of a mutant of which enough is known."""
    done = item.config.stash.get(DONE, ())
    if "supervisor" in item.fixturenames and item.callspec.params["supervisor"].stem in done:
        pytest.skip("enough is known of it")


class Table:
    """Collects the reports of all processes."""

    def __init__(self):
        self.caught = collections.defaultdict(set)
        self.seconds = collections.Counter()
        self.errors = []

    def pytest_runtest_logreport(self, report):
        """Take what a test has found."""
        for name, value in report.user_properties if report.when == "call" else ():
            if name == CAUGHT:
                mutant, caught, seconds, error = value
                self.caught[mutant].update(caught)
                self.seconds[mutant] += seconds
                if error and not caught:
                    self.errors.append(f"{report.nodeid}: {error}")
        if report.when != "call" and report.failed:
            self.errors.append(f"{report.nodeid}: {report.longreprtext}")


def main():
    """Run the mutants and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="of mutants; without one, all")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes of pytest")
    parser.add_argument("--first", action="store_true", help="one requirement for each is enough")
    arguments = parser.parse_args()
    for name in arguments.names:
        if name not in MUTANTS:
            parser.error(f"{name!r} is none of: {', '.join(MUTANTS)}")
    names = arguments.names or list(MUTANTS)
    begun, table = time.monotonic(), Table()
    with tempfile.TemporaryDirectory() as folder:
        write_mutants(Path(folder), names)
        os.environ[FILES] = folder
        if arguments.first:
            os.environ[FIRST] = "1"
        options = ["-q", "--no-header", "-p", "mutants", "-p", "no:cacheprovider", "--tb=no"]
        # What is imported here already cannot be rewritten, and need not be.
        options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
        options += [
            "--rpud-artefacts=",
            "-k",
            "not makes_itself_safe and not again",
            "--no-summary",
        ]
        if arguments.jobs > 1 and importlib.util.find_spec("xdist"):
            options += ["-n", str(min(arguments.jobs, len(names))), "--dist", "loadgroup"]
        pytest.main([str(TESTS), *options], plugins=[table])
    width = max(map(len, names))
    print(f"\n{'mutant':{width}}  time [s]  caught by")
    for name in names:
        caught = ", ".join(sorted(table.caught[name])) or "nothing"
        print(f"{name:{width}}  {table.seconds[name]:8.1f}  {caught}")
    survived = [name for name in names if not table.caught[name]]
    print(f"{len(names) - len(survived)} of {len(names)} mutants caught", end=" ")
    print(f"in {time.monotonic() - begun:.0f} s")
    print(*table.errors, sep="\n", file=sys.stderr)
    sys.exit(1 if survived or table.errors else 0)


if __name__ == "__main__":
    main()
