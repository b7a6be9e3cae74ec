"""`rpud export` and `rpud report` from the shell: what they print, and their exit codes."""

import json

import pytest
from sample_bags import DAMAGED, STRING_DEFINITION, TALK, write_bag, write_damaged
from support import extended

from rpud_sim.bag import BagWriter, Topic


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "bag")


@pytest.mark.extended
def test_it_says_what_it_made(bag, tmp_path, rpud):
    code, out, err = rpud("export", bag, "--out", tmp_path / "new" / "out", "--format", "csv")
    assert (code, err) == (0, "")
    lines = [line.split() for line in out.splitlines()]
    assert lines[0] == ["topic", "messages", "rows", "size", "[MB]", "file"]
    assert lines[1][:3] == ["/rpud/chat", "0", "0"]
    assert lines[2][:3] == ["/rpud/talk", "10", "10"]
    assert lines[2][-1] == "rpud.talk.csv"
    assert (tmp_path / "new" / "out" / "rpud.talk.csv").is_file()


WRITING = (extended(("export",)), extended(("export", "--format", "csv")), ("report",))


@pytest.mark.parametrize("words", WRITING)
def test_json_is_one_object_and_names_what_is_left_out(tmp_path, rpud, words):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.add_topic(Topic("/untold", "pkg/msg/Untold"))
    command, *further = words
    to = ("--out", tmp_path / "out", "--json", *further)
    code, out, err = rpud(command, tmp_path / "bag", *to)
    reason = "the bag does not hold the definition of its type"
    assert (code, err) == (0, f"rpud {command}: left out /untold: {reason}\n")
    content = json.loads(out)
    assert (content["left_out"], content["damaged"]) == ({"/untold": reason}, {})
    if command == "report":
        assert (content["out"], content["topics"]) == (str(tmp_path / "out"), 1)
        return
    (talk,) = content["topics"]
    assert (talk["name"], talk["type"], talk["rows"]) == (TALK.name, TALK.type, 0)
    account = json.loads((tmp_path / "out" / "export.json").read_text())
    assert account.items() >= content.items()


@pytest.mark.extended
def test_an_export_of_nothing_fails_with_the_reason(tmp_path, rpud):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(Topic("/untold", "pkg/msg/Untold"))
    code, _, err = rpud("export", tmp_path / "bag", "--out", tmp_path / "out")
    assert code == 1
    assert "bag can be exported: /untold: the bag does not hold the definition" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("words", WRITING)
def test_what_is_damaged_is_left_out_and_all_else_is_there(tmp_path, rpud, words):
    path = write_damaged(tmp_path / "bag")
    command, *further = words
    to = ("--out", tmp_path / "out", "--json", *further)
    code, out, err = rpud(command, path, *to)
    content = json.loads(out)
    assert (code, content["left_out"]) == (3, {})
    # A report reads no topic without numbers; an export keeps a record as it is.
    unseen = TALK.name if command == "report" else "record rpud_manifest"
    seen = {name: reason for name, reason in DAMAGED.items() if name != unseen}
    assert seen.keys() <= content["damaged"].keys() <= DAMAGED.keys()
    for name, reason in seen.items():
        assert reason in content["damaged"][name]
        assert f"rpud {command}: left out {name}: " in err
    if command == "export":
        assert [each["rows"] for each in content["topics"]] == [3]


@pytest.mark.extended
def test_a_rebuilt_waveform_and_its_size(drill_bag, tmp_path, rpud):
    words = ("--rate", "1e6", "--duration", 0.1)
    code, out, err = rpud("export", drill_bag, "--out", tmp_path / "out", *words)
    assert (code, err) == (0, "")
    lines = out.splitlines()
    where = "rebuilt 100000 samples at 1000000 Hz in rpud.trajectory.parquet: "
    assert lines[0].startswith(where)
    assert lines[1].startswith("the bag's trajectory is 0.0")


def test_a_report_says_where_its_page_is(bag, rpud, monkeypatch):
    monkeypatch.chdir(bag.parent)
    assert rpud("report", "bag") == (0, "report.html: 10 messages on 2 topics\n", "")
    assert (bag.parent / "report.html").read_text().startswith("<!DOCTYPE html>")
