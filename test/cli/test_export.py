"""`rpud export` from the shell: what it prints, and its exit codes."""

import json

import pytest
from sample_bags import (
    DAMAGED,
    STRING_DEFINITION,
    TALK,
    write_bag,
    write_damaged,
    write_offline_bag,
)

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.simulation import preset


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "bag")


def test_it_says_what_it_made(bag, tmp_path, rpud):
    code, out, err = rpud("export", bag, "--out", tmp_path / "new" / "out", "--format", "csv")
    assert (code, err) == (0, "")
    lines = [line.split() for line in out.splitlines()]
    assert lines[0] == ["topic", "messages", "rows", "size", "[MB]", "file"]
    assert lines[1][:3] == ["/rpud/chat", "0", "0"]
    assert lines[2][:3] == ["/rpud/talk", "10", "10"]
    assert lines[2][-1] == "rpud.talk.csv"
    assert (tmp_path / "new" / "out" / "rpud.talk.csv").is_file()


def test_json_is_one_object_and_names_what_is_left_out(tmp_path, rpud):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.add_topic(Topic("/untold", "pkg/msg/Untold"))
    code, out, err = rpud("export", tmp_path / "bag", "--out", tmp_path / "out", "--json")
    reason = "the bag does not hold the definition of its type"
    assert (code, err) == (0, f"rpud export: left out /untold: {reason}\n")
    content = json.loads(out)
    assert (content["format"], content["left_out"]) == ("parquet", {"/untold": reason})
    size = (tmp_path / "out" / "rpud.talk.parquet").stat().st_size
    assert content["topics"] == [
        {
            "name": "/rpud/talk",
            "type": "std_msgs/msg/String",
            "messages": 0,
            "rows": 0,
            "path": "rpud.talk.parquet",
            "size": size,
        }
    ]
    account = json.loads((tmp_path / "out" / "export.json").read_text())
    assert account.items() >= content.items()


@pytest.mark.parametrize("file_format", ["csv", "parquet", "numpy"])
def test_what_is_damaged_is_left_out_and_all_else_is_there(tmp_path, rpud, file_format):
    path = write_damaged(tmp_path / "bag")
    words = ("--out", tmp_path / "out", "--format", file_format, "--json")
    code, out, err = rpud("export", path, *words)
    content = json.loads(out)
    assert (code, content["left_out"]) == (3, {})
    [talk] = content["topics"]
    assert (talk["name"], talk["messages"], talk["rows"]) == (TALK.name, 3, 3)
    damaged = dict(content["damaged"])
    assert [*damaged] == [name for name in DAMAGED if name in damaged]
    for name, reason in DAMAGED.items():
        if name != "record rpud_manifest":  # it is kept as it is
            assert reason in damaged[name]
            assert f"rpud export: left out {name}: " in err
    assert json.loads((tmp_path / "out" / "export.json").read_text())["damaged"] == damaged


@pytest.fixture(scope="module")
def drill_bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "bag"
    write_offline_bag(path, preset("drilling"), 0.2, 0.4)
    return path


def test_a_rebuilt_waveform_and_its_size(drill_bag, tmp_path, rpud):
    words = ("--rate", "1e6", "--duration", 0.1, "--format", "numpy")
    code, out, err = rpud("export", drill_bag, "--out", tmp_path / "out", *words)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == "rebuilt 100000 samples at 1000000 Hz in rpud.trajectory: 8.80 MB"
    assert lines[1].startswith("the bag's trajectory is 0.0")
