"""A broken equation is caught: each mutation of a copy fails its check in test_equations.py."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import rpud_sim

PACKAGE = Path(rpud_sim.__file__).parent
CHECKS = Path(__file__).with_name("test_equations.py")

# equation, the file it is in, its text, what becomes of it
MUTATIONS = [
    (6, "collision.py", "(mass_2 - restitution * mass_1)", "(mass_2 + restitution * mass_1)"),
    (6, "resets.py", "drill.actuator_restitution", "drill.drill_tool_restitution"),
    (8, "suspension.py", "(w * motion.sine - a * motion.cosine)", "(w * motion.sine)"),
    (13, "collision.py", "(mass_1 - restitution * mass_2)", "(mass_1 + restitution * mass_2)"),
    (13, "resets.py", "drill.drill_tool_restitution", "drill.actuator_restitution"),
    (22, "contact.py", "3.0 * k_1 * k_2", "2.0 * k_1 * k_2"),
    (27, "contact.py", "k_1**2 - k_1 * k_2", "k_1**2 + k_1 * k_2"),
    (36, "contact.py", "(displacement - rest) * cosine\n", "displacement * cosine\n"),
    (39, "contact.py", "return 2.0 * time_of_maximum(", "return time_of_maximum("),
]


def run_check(folder: Path, equation: int) -> subprocess.CompletedProcess:
    """Run the checks of an equation on the package in a folder, without compiling its kernels."""
    program = (
        "import runpy, sys\n"
        "checks = runpy.run_path(sys.argv[1])\n"
        "names = [name for name in checks if name.startswith(f'test_equation_{sys.argv[2]}_')]\n"
        "if not names or not checks['contact'].__file__.startswith(sys.argv[3]):\n"
        "    sys.exit('the copy was not checked')\n"
        "for name in names: checks[name]()\n"
        "print('checked', *names)\n"
    )
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(folder)}
    return subprocess.run(
        [sys.executable, "-c", program, CHECKS, str(equation), str(folder)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.fixture
def copy(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "rpud_sim", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_the_checks_pass_on_an_unbroken_copy(copy):
    for equation in (6, 36):
        result = run_check(copy, equation)
        assert result.returncode == 0, result.stderr
        assert "checked" in result.stdout


@pytest.mark.parametrize(
    ("equation", "name", "text", "broken"),
    MUTATIONS,
    ids=[f"equation_{number}-{name}" for number, name, _, _ in MUTATIONS],
)
def test_a_broken_equation_is_caught(copy, equation, name, text, broken):
    source = copy / "rpud_sim" / "model" / name
    content = source.read_text(encoding="utf-8")
    assert text in content, f"{name} no longer has {text!r}: mutate what stands there now"
    source.write_text(content.replace(text, broken, 1), encoding="utf-8")

    result = run_check(copy, equation)

    assert result.returncode != 0, f"nothing noticed {text!r} -> {broken!r}"
    assert "AssertionError" in result.stderr, result.stderr
