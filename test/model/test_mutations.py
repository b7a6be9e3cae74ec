"""A broken equation is caught: each mutation of a copy fails its check in test_equations.py."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import rpud_sim

pytestmark = pytest.mark.extended
PACKAGE = Path(rpud_sim.__file__).parent
CHECKS = Path(__file__).with_name("test_equations.py")
# equation, the file it is in, its text, what becomes of it
MUTATIONS = [
    (6, "contact.py", "(mass_2 - restitution * mass_1)", "(mass_2 + restitution * mass_1)"),
    (6, "resets.py", "drill.actuator_restitution", "drill.drill_tool_restitution"),
    (8, "closed_form.py", "(w * motion.sine - a * motion.cosine)", "(w * motion.sine)"),
    (13, "contact.py", "(mass_1 - restitution * mass_2)", "(mass_1 + restitution * mass_2)"),
    (13, "resets.py", "drill.drill_tool_restitution", "drill.actuator_restitution"),
    (22, "contact_models.py", "3.0 * k_1 * k_2", "2.0 * k_1 * k_2"),
    (27, "contact_models.py", "k_1 * k_1 - k_1 * k_2", "k_1 * k_1 + k_1 * k_2"),
    (
        36,
        "contact.py",
        "across * sine + along * cosine",
        "across * sine + self.displacement * cosine",
    ),
    (39, "contact.py", "return 2.0 * self.time_of_maximum", "return self.time_of_maximum"),
]
PROGRAM = """
import json, runpy, sys, traceback
from pathlib import Path

from hypothesis import Phase, settings

# What breaks is not shrunk: that would take half a minute of a slow machine.
settings.register_profile(
    "once", database=None, deadline=None, derandomize=True, phases=[Phase.generate]
)
settings.load_profile("once")
checks, folder, requests = sys.argv[1], Path(sys.argv[2]), json.loads(sys.argv[3])

def check(equation, name, text, broken):
    for module in [each for each in sys.modules if each.partition(".")[0] == "rpud_sim"]:
        del sys.modules[module]
    source = folder / "rpud_sim" / "model" / name
    content = source.read_text(encoding="utf-8")
    if text not in content:
        return f"{name} no longer has {text!r}: mutate what stands there now"
    source.write_text(content.replace(text, broken, 1), encoding="utf-8")
    try:
        space = runpy.run_path(checks)
        tests = [each for each in space if each.startswith(f"test_equation_{equation}_")]
        if not tests or not space["contact"].__file__.startswith(str(folder)):
            return "the copy was not checked"
        for each in tests:
            space[each]()
    except AssertionError:
        return "caught"
    except Exception:
        return traceback.format_exc()
    finally:
        source.write_text(content, encoding="utf-8")
    return "passed"

print(json.dumps([check(*request) for request in requests]))
"""
UNBROKEN = [(6, "contact.py", "", ""), (36, "contact.py", "", "")]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """Outcome of the checks on a copy of the package, for each mutation; kernels stay Python."""
    folder = tmp_path_factory.mktemp("mutations")
    shutil.copytree(
        PACKAGE, folder / "rpud_sim", ignore=shutil.ignore_patterns("__pycache__", "compiled")
    )
    requests = [*UNBROKEN, *MUTATIONS]
    done = subprocess.run(
        [sys.executable, "-B", "-c", PROGRAM, CHECKS, folder, json.dumps(requests)],
        cwd=folder,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(folder)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return dict(zip(requests, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("equation", UNBROKEN, ids=["equation_6", "equation_36"])
def test_the_checks_pass_on_an_unbroken_copy(outcomes, equation):
    assert outcomes[equation] == "passed"


@pytest.mark.parametrize(
    "mutation", MUTATIONS, ids=[f"equation_{number}-{name}" for number, name, _, _ in MUTATIONS]
)
def test_a_broken_equation_is_caught(outcomes, mutation):
    assert outcomes[mutation] == "caught"
