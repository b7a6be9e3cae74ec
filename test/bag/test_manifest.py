"""Manifest: the same after its record is read, with the machine but not the host."""

import json
import platform

import numpy
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.bag import BagFormatError
from rpud_sim.bag.metadata import (
    Manifest,
    installed_versions,
    machine_name,
    manifest_from_record,
)

VALUES = st.one_of(
    st.booleans(), st.integers(), st.floats(allow_nan=False), st.text(), st.lists(st.floats(0, 1))
)


@given(
    st.builds(
        Manifest,
        node=st.text(),
        time=st.integers(0, 2**63 - 1),
        parameters=st.dictionaries(st.text(), VALUES),
        scenario=st.none() | st.text(),
        command=st.lists(st.text()).map(tuple),
        versions=st.dictionaries(st.text(), st.text()),
        machine=st.text(),
    )
)
def test_it_comes_back_bit_for_bit(manifest):
    assert manifest_from_record(manifest.to_record()) == manifest


@pytest.mark.parametrize(
    ("parameters", "seed"),
    [({"seed": 7.0}, 7), ({"seed": 7}, 7), ({}, None), ({"seed": "x"}, None)],
)
def test_the_seed_is_one_of_the_parameters(parameters, seed):
    assert Manifest(parameters=parameters).seed == seed


@pytest.mark.parametrize(
    "record",
    [
        {},
        {"manifest": ""},
        {"manifest": "[]"},
        {"manifest": "{}"},
        {"manifest": "[" * 100_000},
        {"manifest": json.dumps({**json.loads(Manifest().to_record()["manifest"]), "time": "x"})},
        {"manifest": json.dumps({**json.loads(Manifest().to_record()["manifest"]), "versions": 1})},
    ],
)
def test_what_is_no_manifest_is_one_clear_error(record):
    with pytest.raises(BagFormatError, match="the record rpud_manifest is unreadable"):
        manifest_from_record(record)


def test_versions_and_machine_are_those_of_this_process(monkeypatch):
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    versions = installed_versions()
    assert versions["python"] == platform.python_version()
    assert versions["numpy"] == numpy.__version__
    assert versions["ros_distro"] == "jazzy"
    assert {"rpud_sim", "numba"} <= versions.keys()
    assert machine_name().startswith(platform.machine())
    assert platform.node() not in machine_name().split()


def test_texts_without_an_encoding_are_escaped(tmp_path):
    """File names may be other than UTF-8, and JSON may have halves of surrogate pairs."""
    manifest = Manifest(command=("rpud", "\udcff"), parameters={"scenario": "\ud800"})
    record = manifest.to_record()
    assert "".join(record.values()).encode("utf-8")
    found = manifest_from_record(record)
    assert found.command == ("rpud", "\\xff")
    assert found.parameters == {"scenario": "\\ud800"}
    text = json.dumps(json.loads(record["manifest"]) | {"node": "\udc80\ud800"})
    assert manifest_from_record({"manifest": text}).node.encode("utf-8")
