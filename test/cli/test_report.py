"""`rpud report` from the shell: what it prints, and its exit codes."""

import json

from sample_bags import DAMAGED, STRING_DEFINITION, TALK, write_bag, write_damaged

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.definitions import find_definition


def test_it_says_where_the_page_is(tmp_path, rpud, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "bag")
    code, out, err = rpud("report", "bag")
    assert (code, out, err) == (0, "report.html: 10 messages on 2 topics\n", "")
    assert (tmp_path / "report.html").read_text().startswith("<!DOCTYPE html>")


def test_json_is_one_object_and_what_is_left_out_is_named(tmp_path, rpud):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        bag.add_topic(Topic("/untold", "pkg/msg/Untold"))
    out_file = tmp_path / "out.html"
    code, out, err = rpud("report", tmp_path / "bag", "--out", out_file, "--json")
    reason = "the bag does not hold the definition of its type"
    assert code == 0
    assert err == f"rpud report: left out /untold: {reason}\n"
    assert json.loads(out) == {
        "out": str(out_file),
        "topics": 1,
        "messages": 0,
        "left_out": {"/untold": reason},
        "damaged": {},
    }


def test_what_is_damaged_is_left_out_and_all_else_is_shown(tmp_path, rpud):
    path = write_damaged(tmp_path / "bag")
    code, out, err = rpud("report", path, "--out", tmp_path / "out.html", "--json")
    content = json.loads(out)
    assert (code, content["topics"], content["left_out"]) == (3, 1, {})
    read = {name: reason for name, reason in DAMAGED.items() if name != TALK.name}
    assert content["damaged"].keys() == read.keys()  # a topic without numbers is not read
    for line in err.splitlines():
        [reason] = [read[name] for name in read if f"left out {name}: " in line]
        assert reason in line
    assert len(err.splitlines()) == len(read)


def test_a_bag_of_which_nothing_can_be_read_has_a_report(tmp_path, rpud):
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(Topic("/untold", "pkg/msg/Untold"))
        bag.write("/untold", b"\x00\x01\x00\x00", 1, 1)
    code, out, _ = rpud("report", tmp_path / "bag", "--out", tmp_path / "out.html")
    assert (code, out) == (0, f"{tmp_path / 'out.html'}: 0 messages on 0 topics\n")


def test_a_stamped_topic_without_a_readable_message_is_shown(tmp_path, rpud):
    wrench = "geometry_msgs/msg/WrenchStamped"
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(Topic("/odd", wrench), find_definition(wrench))
        bag.write("/odd", b"\x00\x01\x00\x00\xff", 1, 1)
    code, out, err = rpud("report", tmp_path / "bag", "--out", tmp_path / "out.html")
    assert (code, out) == (3, f"{tmp_path / 'out.html'}: 1 messages on 1 topics\n")
    assert err.startswith("rpud report: left out /odd: ")
