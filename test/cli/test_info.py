"""``rpud info`` shows people and programs the same."""

import json

import pytest
from sample_bags import CHAT, START, STRING, TALK, write_bag, write_mcap

from rpud_sim.bag import BagWriter
from rpud_sim.bag.losses import LOSSES_RECORD, Losses, losses_to_record
from rpud_sim.cli.main import execute


def run(*words):
    return execute(["info", *map(str, words)])


def test_table_and_json_have_the_figures(tmp_path, capsys):
    path = write_bag(tmp_path / "run", 11)
    assert run(path) == 0
    lines = capsys.readouterr().out.splitlines()
    assert {"duration  0.010 s", "start     2023-11-14 22:13:20.000 UTC", "messages  11"} < {*lines}
    [talk] = [line.split() for line in lines if line.startswith(TALK.name)]
    assert talk == [TALK.name, STRING, "11", "1000.00", "unknown"]
    assert run(path, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {
        "path": str(path),
        "duration": 10_000_000,
        "start_time": START,
        "end_time": START + 10_000_000,
        "message_count": 11,
        "size": (path / "run_0.mcap").stat().st_size,
        "compression": "zstd",
        "topics": [
            {
                "name": CHAT.name,
                "type": STRING,
                "message_count": 0,
                "rate": None,
                "losses": None,
            },
            {
                "name": TALK.name,
                "type": STRING,
                "message_count": 11,
                "rate": pytest.approx(1000.0),
                "losses": None,
            },
        ],
    }


def test_losses_are_shown(tmp_path, capsys):
    with BagWriter(tmp_path / "run") as bag:
        bag.add_topic(TALK)
        bag.add_topic(CHAT)
        losses = {TALK.name: Losses(2, 1), CHAT.name: Losses(None, 1)}
        bag.add_record(LOSSES_RECORD, losses_to_record(losses))
    assert run(tmp_path / "run", "--json") == 0
    topics = json.loads(capsys.readouterr().out)["topics"]
    assert [topic["losses"] for topic in topics] == [None, 3]


# Nine messages, or 20 without an index, as of `ros2 bag record --storage-preset-profile fastwrite`.
@pytest.mark.parametrize(("number", "indexed"), [(9, True), (20, False)])
def test_few_messages_and_those_without_an_index_have_no_rate(tmp_path, capsys, number, indexed):
    messages = [("/a", START + 10**6 * each, b"") for each in range(number)]
    file = write_mcap(tmp_path / "a.mcap", messages, use_chunking=indexed)
    assert run(file) == 0
    last = capsys.readouterr().out.splitlines()[-1].split()
    assert last == ["/a", STRING, str(number), "-", "unknown"]
    assert run(file, "--json") == 0
    assert json.loads(capsys.readouterr().out)["topics"][0]["rate"] is None


def test_an_empty_bag_has_no_times(tmp_path, capsys):
    assert run(write_bag(tmp_path / "run", 0)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert {"duration  0.000 s", "start     -", "end       -", "messages  0"} <= set(lines)
