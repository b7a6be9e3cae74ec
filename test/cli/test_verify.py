"""`rpud verify` from the shell: what it prints, and its exit codes."""

import json

from altered_bags import altered


def test_a_proved_bag_gives_0(drill_bag, rpud):
    code, out, err = rpud("verify", drill_bag)
    assert (code, err) == (0, "")
    head = ["topic", "equal", "different", "unexpected", "missing", "tail", "before", "lost"]
    assert out.splitlines()[0].split() == head
    assert "messages are equal bit for bit, 0.200 s simulated again" in out


def test_an_altered_bag_gives_3_and_the_first_difference(drill_bag, tmp_path, rpud):
    def change(message):
        altered_one = message.topic == "/rpud/wrench" and message.log_time == 70_000_000
        return [message.data[:-1] + b"\x01"] if altered_one else [message.data]

    altered(drill_bag, tmp_path / "bag", change)
    code, out, err = rpud("verify", tmp_path / "bag", "--json")
    assert (code, err) == (3, "")
    content = json.loads(out)
    difference = content["first_difference"]
    assert content["proved"] is False
    assert content["topics"]["/rpud/wrench"]["different"] == 1
    assert (difference["topic"], difference["stamp"], difference["field"]) == (
        "/rpud/wrench",
        70_000_000,
        "wrench.torque.z",
    )
    assert difference["computed"] == "0.0"


def test_a_bag_that_lacks_its_tail_gives_1_and_the_number(drill_bag, tmp_path, rpud):
    def change(message):
        deaf = message.topic == "/rpud/wrench" and message.log_time > 50_000_000
        return [] if deaf else [message.data]

    altered(drill_bag, tmp_path / "bag", change)
    code, out, err = rpud("verify", tmp_path / "bag")
    assert (code, err) == (1, "")
    *_, missing, verdict = out.splitlines()
    assert missing == "/rpud/wrench: 15 messages are missing at the end, while the drill went on"
    assert verdict.startswith("not proved: ")
    assert "messages are equal bit for bit, and 15 are missing, 0.200 s simulated" in verdict
    code, out, err = rpud("verify", tmp_path / "bag", "--json")
    content = json.loads(out)
    assert (code, content["proved"], content["undecided"]) == (1, False, "")
    assert content["topics"]["/rpud/wrench"]["tail"] == 15


def test_missing_messages_between_recorded_ones_are_said_and_strict_gives_3(
    drill_bag, tmp_path, rpud
):
    assert rpud("verify", drill_bag, "--strict")[0] == 0

    def change(message):
        lost = message.topic == "/rpud/wrench" and 50_000_000 < message.log_time < 100_000_000
        return [] if lost else [message.data]

    altered(drill_bag, tmp_path / "bag", change)
    code, out, err = rpud("verify", tmp_path / "bag")
    assert (code, err) == (0, "")
    assert "bit for bit, and 4 are missing, 0.200 s simulated again" in out.splitlines()[-1]
    assert rpud("verify", tmp_path / "bag", "--strict")[0] == 3
