"""`rpud report` from the shell: what it prints, and its exit codes."""

from sample_bags import write_bag

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.definitions import find_definition


def test_it_says_where_the_page_is(tmp_path, rpud, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "bag")
    code, out, err = rpud("report", "bag")
    assert (code, out, err) == (0, "report.html: 10 messages on 2 topics\n", "")
    assert (tmp_path / "report.html").read_text().startswith("<!DOCTYPE html>")


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
