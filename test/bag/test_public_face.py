"""What a script can import from ``rpud_sim.bag``."""

import inspect
import subprocess
import sys

import pytest

import rpud_sim.bag


@pytest.mark.parametrize("name", rpud_sim.bag.__all__)
def test_every_public_name_has_a_docstring_and_annotations(name):
    thing = getattr(rpud_sim.bag, name)
    assert inspect.getdoc(thing)
    members = [(name, thing)] if inspect.isfunction(thing) else inspect.getmembers(thing)
    for member, value in members:
        if inspect.isfunction(value) and not member.startswith("_"):
            assert inspect.getdoc(value)
            assert "return" in value.__annotations__


def test_the_public_names_are_listed():
    assert dir(rpud_sim.bag) == sorted(rpud_sim.bag.__all__)


def test_listing_a_bag_loads_no_libraries_for_tables():
    code = "import sys, rpud_sim.bag; print({'numpy', 'rosbags', 'pandas'} & set(sys.modules))"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "set()\n"


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        rpud_sim.bag.nonsense  # noqa: B018
