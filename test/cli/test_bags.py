"""`rpud info`, `recover`, `verify` and `fork` from the shell: what they print, and exit codes."""

import json
import re
import shutil

import pytest
from altered_bags import altered
from raw_mcap import RawMcap
from sample_bags import CHAT, START, STRING, TALK, write_bag, write_mcap

import rpud_sim.bag
from rpud_sim.bag import BagWriter
from rpud_sim.bag.metadata import LOSSES_RECORD, Losses, losses_to_record


def test_info_shows_people_and_programs_the_same(tmp_path, rpud):
    path = write_bag(tmp_path / "run", 11)
    code, out, _ = rpud("info", path)
    lines = out.splitlines()
    assert code == 0
    assert {"duration  0.010 s", "start     2023-11-14 22:13:20.000 UTC", "messages  11"} < {*lines}
    [talk] = [line.split() for line in lines if line.startswith(TALK.name)]
    assert talk == [TALK.name, STRING, "11", "1000.00", "unknown"]
    chat = {"name": CHAT.name, "type": STRING, "message_count": 0, "rate": None, "losses": None}
    rate = pytest.approx(1000.0)
    assert json.loads(rpud("info", path, "--json")[1]) == {
        "path": str(path),
        "duration": 10_000_000,
        "start_time": START,
        "end_time": START + 10_000_000,
        "message_count": 11,
        "size": (path / "run_0.mcap").stat().st_size,
        "compression": "zstd",
        "topics": [chat, {**chat, "name": TALK.name, "message_count": 11, "rate": rate}],
    }


def test_info_shows_every_type_of_a_topic(tmp_path, rpud):
    parts = [
        RawMcap([("/a", START, b"\0\1\0\0\1")], type=kind).content() for kind in ("a/msg/A", "b/B")
    ]
    for number, content in enumerate(parts):
        (tmp_path / f"run_{number}.mcap").write_bytes(content)
    [topic] = json.loads(rpud("info", tmp_path, "--json")[1])["topics"]
    assert topic["type"] == "a/msg/A, b/msg/B"


def test_info_shows_losses(tmp_path, rpud):
    with BagWriter(tmp_path / "run") as bag:
        bag.add_topic(TALK)
        bag.add_topic(CHAT)
        losses = {TALK.name: Losses(2, 1), CHAT.name: Losses(None, 1)}
        bag.add_record(LOSSES_RECORD, losses_to_record(losses))
    topics = json.loads(rpud("info", tmp_path / "run", "--json")[1])["topics"]
    assert [topic["losses"] for topic in topics] == [None, 3]


def test_recover_without_a_loss_gives_0(tmp_path, rpud):
    path = write_bag(tmp_path / "run", 11)
    (path / "metadata.yaml").unlink()
    code, out, _ = rpud("recover", path, "--out", tmp_path / "out")
    lines = out.splitlines()
    assert (code, lines[0]) == (0, f"recovered 11 messages to {tmp_path / 'out'}")
    assert lines[-1] == "nothing is lost"
    assert [line.split() for line in lines if line.startswith("/")] == [
        [CHAT.name, STRING, "0", "0"],
        [TALK.name, STRING, "11", "0"],
    ]
    assert rpud("info", tmp_path / "out")[0] == 0


def test_a_loss_is_shown_with_exit_code_3_and_json_has_the_account(tmp_path, rpud):
    torn = write_bag(tmp_path / "run", 50, compression="none", chunk_size=500) / "run_0.mcap"
    (tmp_path / "run" / "metadata.yaml").unlink()
    content = torn.read_bytes()
    torn.write_bytes(content[: content.index(b"message 40")])
    code, out, _ = rpud("recover", torn, "--out", tmp_path / "out")
    assert code == 3
    for text in (
        "recovered 34 messages",
        "bytes) is not a whole chunk",
        "not closed: what its recorder had yet to write is missing",
    ):
        assert text in out
    assert "nothing is lost" not in out
    code, out, _ = rpud("recover", torn.parent, "--out", tmp_path / "json", "--json")
    account = json.loads(out)
    assert (code, account["path"]) == (3, str(tmp_path / "json"))
    assert (account["complete"], account["closed"], account["max_loss"]) == (False, False, None)
    assert account["message_count"] == 34
    assert account["damage_count"] == len(account["damages"]) == 1
    chat, talk = account["topics"]
    assert chat["recovered"] == 0
    counts = {"recovered": 34, "unchecked": 0, "lost": 0, "recording_losses": None}
    assert talk == {"name": TALK.name, "type": STRING, **counts}


def test_verify_proves_a_bag(drill_bag, rpud):
    code, out, err = rpud("verify", drill_bag)
    assert (code, err) == (0, "")
    head = [
        "topic",
        "equal",
        "different",
        "unexpected",
        "head",
        "missing",
        "tail",
        "before",
        "lost",
    ]
    assert out.splitlines()[0].split() == head
    assert "messages are equal bit for bit, 0.200 s simulated again" in out
    assert rpud("verify", drill_bag, "--strict")[0] == 0


def without_wrench(bag, out, first, last):
    """Copy a bag without the wrenches after one time and before another [ms]."""

    def change(message):
        lost = message.topic == "/rpud/wrench" and first < message.log_time / 1e6 < last
        return [] if lost else [message.data]

    return altered(bag, out, change)


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
    assert [difference[name] for name in ("topic", "stamp", "field", "computed")] == [
        *("/rpud/wrench", 70_000_000),
        *("wrench.torque.z", "0.0"),
    ]


def test_a_bag_that_lacks_its_tail_gives_1_and_the_number(drill_bag, tmp_path, rpud):
    path = without_wrench(drill_bag, tmp_path / "bag", 50, 1e9)
    code, out, err = rpud("verify", path)
    assert (code, err) == (1, "")
    *_, missing, verdict = out.splitlines()
    assert missing == "/rpud/wrench: 15 messages are missing at the end, while the drill continued"
    assert re.match(r"incomplete: (\d+) of \d+ messages were recorded, each equal, 0.200", verdict)
    content = json.loads(rpud("verify", path, "--json")[1])
    assert (content["proved"], content["undecided"]) == (False, "")
    assert content["topics"]["/rpud/wrench"]["tail"] == 15


@pytest.mark.parametrize(("first", "last", "column"), [(-1, 55, "head"), (50, 95, "missing")])
def test_a_bag_that_lacks_messages_is_incomplete(drill_bag, tmp_path, rpud, first, last, column):
    whole = json.loads(rpud("verify", drill_bag, "--json")[1])["topics"]
    count = sum(each["equal"] for each in whole.values())
    path = without_wrench(drill_bag, tmp_path / "bag", first, last)
    content = json.loads(rpud("verify", path, "--json")[1])
    lacking = content["topics"]["/rpud/wrench"][column]
    assert (content["proved"], lacking > 3) == (False, True)
    code, out, err = rpud("verify", path)
    assert (code, err) == (0, "")
    said = f"incomplete: {count - lacking:,} of {count:,} messages were recorded, each equal"
    assert out.splitlines()[-1].startswith(said)
    assert rpud("verify", path, "--strict")[0] == 3


def test_a_fork_is_the_rest_of_a_bag(drill_bag, tmp_path, rpud):
    code, out, _ = rpud("fork", drill_bag, "--at", "0.1234", "--out", tmp_path / "fork")
    assert code == 0
    with rpud_sim.bag.open(drill_bag) as opened:
        rest = sum(message.log_time > 123_400_000 for message in opened.messages())
    assert out == (
        f"forked {drill_bag} at 0.1234 s without a change: 0.0766 s and {rest} messages in "
        f"{tmp_path / 'fork'}\n"
    )
    assert rpud("verify", tmp_path / "fork")[0] == 0


def test_a_fork_takes_all_changes_at_once_and_gives_its_account(drill_bag, tmp_path, rpud):
    (tmp_path / "file.yaml").write_text("commands: [{time: 0.01, weight_on_bit: 12}]")
    words = ("--set", "regime=free", "--set", "gravity=3.7", "--duration", "0.3")
    faults = ("--inject", "lost_preload", "--inject", "noise,channel=wrench,onset=0.05")
    files = ("--commands", tmp_path / "file.yaml", "--out", tmp_path / "fork", "--json")
    code, out, _ = rpud("fork", drill_bag, "--at", "0.1", *words, *faults, *files)
    account = json.loads(out)
    assert (code, account["changed"], account["messages"] > 100) == (0, True, True)
    assert (account["at"], account["duration"], account["run"]) == (0.1, 0.3, 1)
    assert rpud("verify", tmp_path / "fork")[0] == 0


def test_what_a_fork_refuses_is_one_line_each(drill_bag, tmp_path, rpud):
    (tmp_path / "file.yaml").write_text("faults: [{kind: hard_rock, onset: 0.01}]")
    words = ("--commands", tmp_path / "file.yaml", "--out", tmp_path / "fork")
    code, _, err = rpud("fork", drill_bag, "--at", "0.1", *words)
    assert code == 0
    assert err.startswith(f"rpud fork: rejected at 0.11 s: {tmp_path / 'file.yaml'}:1: hard_rock")


def test_a_warning_of_a_bag_is_one_line_and_no_failure(tmp_path, rpud):
    file = write_mcap(tmp_path / "a.mcap", [("/a", 5, b"")], use_statistics=False)
    code, out, err = rpud("info", file)
    assert code == 0
    assert "messages  1" in out
    assert err == (
        f"rpud info: {file}: its summary section has no statistics, so the whole file was read "
        "to open it\n"
    )


def test_info_says_that_the_qos_cannot_be_read_and_a_proof_needs_none(tmp_path, rpud):
    metadata = {"offered_qos_profiles": "- {history: 3"}
    file = write_mcap(tmp_path / "a.mcap", [("/a", 5, b"")], metadata=metadata)
    code, _, err = rpud("info", file)
    assert code == 0
    assert err.startswith(f"rpud info: {file}: the QoS of 1 topics, such as /a, cannot be read: ")
    assert "QoS" not in rpud("verify", file)[2]


def test_recover_names_a_missing_file_and_exits_with_3(tmp_path, rpud):
    path = write_bag(tmp_path / "run")
    (path / "run_0.mcap").rename(path / "run_1.mcap")
    shutil.copy(path / "run_1.mcap", path / "run_2.mcap")
    code, out, _ = rpud("recover", path, "--out", tmp_path / "out")
    assert code == 3
    assert "lost: run_0.mcap, which metadata.yaml lists with 10 messages, is missing" in out
    assert "nothing is lost" not in out
