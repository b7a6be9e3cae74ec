"""Two versions of the project do the same work by turns, each with its own sources."""

import os
import sys
from pathlib import Path

import pytest

from bench import checkout as checkouts
from bench.__main__ import main
from bench.checkout import ROOT, Checkout, CheckoutError
from bench.compare import Work, by_turns
from bench.ratios import INCOMPARABLE, SAME, SLOWER

PRINT_COST = ["python", "-c", "import rpud_sim; print(rpud_sim.cost())"]


def version(folder, cost, commit="0" * 40):
    """Return a version of the package whose cost is a number that it prints."""
    package = folder / "rpud_sim"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(f"def cost():\n    return {cost}\n")
    return Checkout(commit, folder, checkouts.clean_environment(folder))


@pytest.fixture
def works():
    said = lambda used: float(used.output)  # noqa: E731
    return {
        "cost": Work(lambda given, out: PRINT_COST, said),
        "constant": Work(lambda given, out: ["python", "-c", "print(2.5)"], said),
    }


def test_a_version_that_costs_more_is_found_and_an_equal_one_is_not(tmp_path, works):
    former, ours = version(tmp_path / "former", 1.0), version(tmp_path / "ours", 1.5)

    slower, same = by_turns(former, ours, works, tmp_path, 3)

    assert (slower.name, slower.verdict, slower.value) == ("cost", SLOWER, pytest.approx(1.5))
    assert slower.beyond(0.1)
    assert (same.name, same.verdict, same.value) == ("constant", SAME, 1.0)
    assert {path.name for path in tmp_path.iterdir()} == {"former", "ours"}


def test_a_work_that_fails_in_one_version_does_not_lose_the_others(tmp_path, works):
    former, ours = version(tmp_path / "former", 1.0), version(tmp_path / "ours", "1 / 0")

    same, broken = by_turns(former, ours, works, tmp_path, 3)

    assert (same.name, same.verdict) == ("constant", SAME)
    assert (broken.name, broken.verdict) == ("cost", INCOMPARABLE)
    assert "exit code 1: ZeroDivisionError" in broken.reason


def test_a_command_imports_the_version_of_its_checkout_wherever_it_runs(tmp_path):
    former = version(tmp_path / "former", 7.0)

    assert former.run(PRINT_COST).output == "7.0\n"
    assert former.run(PRINT_COST, folder=tmp_path).output == "7.0\n"


def test_a_command_tells_its_times_memory_and_code(tmp_path):
    made = version(tmp_path, 1.0, "0123456789")

    used = made.run(["python", "-c", "print('said'); sum(range(10**6))"])

    assert used.output == "said\n"
    assert used.processor > 0.0
    assert used.wall > 0.0
    assert used.memory > 2**20
    assert made.run(["python", "-c", "import sys; sys.exit(3)"], codes=(0, 3)).output == ""
    with pytest.raises(CheckoutError, match=r"^0123456: .*exit code 4: no way$"):
        made.run(["python", "-c", "import sys; print('no way', file=sys.stderr); sys.exit(4)"])


def test_the_memory_of_a_command_is_its_own_and_not_that_of_the_bench(tmp_path):
    made = version(tmp_path, 1.0)
    held = bytearray(b"1" * 2**28)

    used = made.run(["python", "-c", "print(1)"])

    assert used.memory < len(held)


def test_nothing_that_was_built_here_is_found_from_a_checkout(tmp_path, monkeypatch):
    entries = [ROOT / "install/rpud_msgs", ROOT / ".venv/share", Path("/opt/ros/jazzy")]
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(map(str, entries)))
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "build/rpud_sim"))

    environment = checkouts.clean_environment(tmp_path)

    assert environment["AMENT_PREFIX_PATH"] == f"{ROOT}/.venv/share:/opt/ros/jazzy"
    assert environment["PYTHONPATH"] == str(tmp_path)


def test_a_commit_that_is_not_in_the_clone_is_told_in_one_line():
    with pytest.raises(CheckoutError) as raised, checkouts.checkout("0" * 40):
        pass
    assert str(raised.value) == (
        f"commit {'0' * 40} is not in this clone, which may be a shallow one: "
        "git fetch --unshallow brings it"
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing"], "nothing is called nothing; there is engine, "),
        (["--compare", "HEAD", "telemetry"], "nothing is called telemetry; there is engine, "),
        (["--compare", "HEAD", "--pairs", "2"], "--pairs is 2; it must be at least 3"),
        (["--threshold", "nan"], "--threshold is nan %; it must be at least 0 %"),
        (["--telemetry-seconds", "0"], "--telemetry-seconds is 0 s; it must be above 0 s"),
        (["--compare", "no-such-commit"], "commit no-such-commit is not in this clone"),
    ],
)
def test_a_wrong_call_is_told_in_one_line(words, message, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["bench", *words])

    with pytest.raises(SystemExit) as raised:
        sys.exit(main())

    assert raised.value.code == 2
    assert message in capsys.readouterr().err.splitlines()[-1]
