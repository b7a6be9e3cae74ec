"""What `make run` and the other targets install."""

import re
from pathlib import Path

import pytest

REQUIREMENTS = Path(__file__).resolve().parents[2] / "toolchain" / "requirements"
# colcon needs it.
SHARED = {"pytest"}


def named(file: str) -> set[str]:
    """Return the packages that a file asks for, or locks."""
    text = (REQUIREMENTS / file).read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z0-9][a-z0-9._-]*)", text, re.MULTILINE))


@pytest.mark.parametrize(
    ("lock", "rest"), [("wheels", "rest"), ("installed_ros", "installed_ros_rest")]
)
def test_a_drill_installs_nothing_for_tests_and_studies(lock, rest):
    drill, further = named(f"{lock}.lock"), named(f"{rest}.lock")
    assert named("drill.in") <= drill
    assert (named("extras.in") | named("test.in")) - SHARED <= further
    assert drill & further == set()
