"""`rpud fork` from the shell: what it prints, and its exit codes."""

import json

import rpud_sim.bag


def test_the_rest_of_a_bag_is_written(drill_bag, tmp_path, rpud):
    code, out, _ = rpud("fork", drill_bag, "--at", "0.1234", "--out", tmp_path / "fork")
    assert code == 0
    with rpud_sim.bag.open(drill_bag) as opened:
        rest = sum(message.log_time > 123_400_000 for message in opened.messages())
    assert out == (
        f"forked {drill_bag} at 0.1234 s without a change: 0.0766 s and {rest} messages in "
        f"{tmp_path / 'fork'}\n"
    )
    assert rpud("verify", tmp_path / "fork")[0] == 0


def test_all_changes_at_once_and_the_account_as_json(drill_bag, tmp_path, rpud):
    (tmp_path / "file.yaml").write_text("commands: [{time: 0.01, weight_on_bit: 12}]")
    words = ("--set", "regime=free", "--set", "gravity=3.7", "--duration", "0.3")
    faults = ("--inject", "lost_preload", "--inject", "noise,channel=wrench,onset=0.05")
    files = ("--commands", tmp_path / "file.yaml", "--out", tmp_path / "fork", "--json")
    code, out, _ = rpud("fork", drill_bag, "--at", "0.1", *words, *faults, *files)
    assert code == 0
    account = json.loads(out)
    assert account["changed"] is True
    assert (account["at"], account["duration"], account["run"]) == (0.1, 0.3, 1)
    assert account["messages"] > 100
    assert rpud("verify", tmp_path / "fork")[0] == 0


def test_what_a_repeat_refuses_is_one_line_each(drill_bag, tmp_path, rpud):
    (tmp_path / "file.yaml").write_text("faults: [{kind: hard_rock, onset: 0.01}]")
    words = ("--commands", tmp_path / "file.yaml", "--out", tmp_path / "fork")
    code, _, err = rpud("fork", drill_bag, "--at", "0.1", *words)
    assert code == 0
    assert err.endswith(
        "rpud fork: refused at 0.11 s: hard_rock cannot be honoured: it needs a rock_model, "
        "which is none, or strata\n"
    )
