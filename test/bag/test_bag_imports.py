"""What a script can import from ``rpud_sim.bag``."""

import subprocess
import sys

import pytest

import rpud_sim.bag


def test_the_public_names_are_listed():
    assert dir(rpud_sim.bag) == sorted(rpud_sim.bag.__all__)


@pytest.mark.parametrize(
    ("module", "libraries"),
    [
        ("rpud_sim.bag", {"numpy", "rosbags", "pandas"}),
        # A drill runs where the libraries of bags are missing: no rosdistro has them.
        ("rpud_sim.ros.drill.drill_node", {"lz4", "mcap", "rosbags", "zstandard"}),
    ],
)
def test_libraries_are_loaded_where_they_are_needed(module, libraries):
    code = f"import sys, {module}; print({libraries} & set(sys.modules))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "set()\n"
