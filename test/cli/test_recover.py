"""`rpud recover` says what it saved, and its exit code whether that is all."""

import json

import pytest
from sample_bags import CHAT, STRING, TALK, write_bag

from rpud_sim.bag.losses import RECORDING_RECORD
from rpud_sim.cli.main import execute


def run(*words, command="recover"):
    return execute([command, *map(str, words)])


@pytest.fixture
def torn(tmp_path):
    """The file of a bag that was never closed."""
    file = write_bag(tmp_path / "run", 50, compression="none", chunk_size=500) / "run_0.mcap"
    (tmp_path / "run" / "metadata.yaml").unlink()
    content = file.read_bytes()
    file.write_bytes(content[: content.index(b"message 40")])
    return file


def test_nothing_lost_is_0(tmp_path, capsys):
    path = write_bag(tmp_path / "run", 11)
    (path / "metadata.yaml").unlink()
    assert run(path, "--out", tmp_path / "out") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"recovered 11 messages to {tmp_path / 'out'}"
    assert lines[-1] == "nothing is lost"
    assert [line.split() for line in lines if line.startswith("/")] == [
        [CHAT.name, STRING, "0", "0"],
        [TALK.name, STRING, "11", "0"],
    ]
    assert run(tmp_path / "out", command="info") == 0


def test_a_loss_is_shown_with_exit_code_3_and_json_has_the_account(torn, tmp_path, capsys):
    assert run(torn, "--out", tmp_path / "out") == 3
    output = capsys.readouterr().out
    assert "recovered 40 messages" in output
    assert "a chunk that is cut off" in output
    assert "messages on /rpud/talk have no checksum" in output
    assert "not closed: what its recorder had yet to write is missing" in output
    assert "nothing is lost" not in output
    assert run(torn.parent, "--out", tmp_path / "json", "--json") == 3
    account = json.loads(capsys.readouterr().out)
    assert account["path"] == str(tmp_path / "json")
    assert (account["complete"], account["closed"], account["max_loss"]) == (False, False, None)
    assert account["message_count"] == 40
    assert account["damage_count"] == len(account["damages"]) == 1
    chat, talk = account["topics"]
    assert chat["recovered"] == 0
    assert 0 < talk.pop("unchecked") < 20
    assert talk == {
        "name": TALK.name,
        "type": STRING,
        "recovered": 40,
        "lost": 0,
        "recording_losses": None,
    }


def test_the_recorder_s_bound_is_shown(tmp_path, capsys):
    from rpud_sim.bag import BagWriter

    with BagWriter(tmp_path / "run") as bag:
        bag.add_record(RECORDING_RECORD, {"max_loss": "0.5"})
        bag.flush()
        assert run(tmp_path / "run", "--out", tmp_path / "out") == 3
    assert capsys.readouterr().out.endswith(
        "is missing, at most 0.5 s if processor and disk kept up\n"
    )
