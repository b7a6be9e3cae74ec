"""What the recorder does beside recording, with real processes over DDS."""

import shlex
import sys
from pathlib import Path

import pytest

import rpud_sim.bag
from rpud_sim.bag.manifest import RECORD_NAME as MANIFEST
from rpud_sim.bag.manifest import manifest_from_record

HERE = Path(__file__).parent
CONTACT_FORCE = "/rpud/contact_force"
STATUS = "/rpud/status"


@pytest.fixture
def talker(process):
    """Start the talker; it begins as soon as its three topics are heard."""
    return lambda *words: process(sys.executable, HERE / "talker.py", *map(str, words))


def manifests(path):
    with rpud_sim.bag.open(path) as bag:
        return [manifest_from_record(record) for record in bag.records(MANIFEST)]


def test_a_bag_tells_what_it_is_a_recording_of(process, tmp_path):
    scenario = tmp_path / "faults.yaml"
    scenario.write_text("faults:\n  - {kind: lost_preload, onset: 100.0}\n")
    settings = {"seed": 7.0, "gravity": 3.71, "regime": "drilling", "scenario": str(scenario)}
    words = [word for item in settings.items() for word in ("-p", "{}:={}".format(*item))]
    process("drill_node", "--ros-args", "-r", "__ns:=/rpud", *words)
    recorder = process("recorder", "contact_force", "--out", tmp_path / "run")
    recorder.wait_for_line("knows the parameters of /rpud/drill_node")
    recorder.interrupt()
    assert recorder.wait() == 0
    [manifest] = manifests(tmp_path / "run")
    assert manifest.node == "/rpud/drill_node"
    assert {name: manifest.parameters[name] for name in settings} == settings
    assert manifest.parameters["drive_enabled"] is True
    assert manifest.seed == 7
    assert manifest.scenario == scenario.read_text()
    assert shlex.join(manifest.command).endswith(f"contact_force --out {tmp_path / 'run'}")
    assert manifest.versions.keys() >= {"rpud_sim", "python", "numpy", "numba", "ros_distro"}


def test_a_bag_without_a_drill_has_a_manifest_too(process, tmp_path):
    recorder = process("recorder", "--out", tmp_path / "run", "--duration", "0.1")
    assert recorder.wait() == 0
    [manifest] = manifests(tmp_path / "run")
    assert (manifest.node, manifest.parameters, manifest.seed) == ("", {}, None)
    assert manifest.machine
