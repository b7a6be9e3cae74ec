"""``rpud run --record`` and a signal that comes while it starts."""

import sys
from unittest.mock import MagicMock

import pytest

from rpud_sim.cli import run
from rpud_sim.cli.program import ExitCode


@pytest.mark.parametrize("moment", ["before the recorder", "while it starts"])
def test_a_stop_before_there_is_a_bag_is_done_and_says_so(monkeypatch, tmp_path, capsys, moment):
    early = moment == "before the recorder"
    stop = MagicMock(requested=early, wait=lambda seconds: early)
    recorder = MagicMock(code=-15, output="", errors="", running=True)

    def first_line(seconds, cancelled):
        stop.requested = True
        return ""

    recorder.first_line = first_line
    monkeypatch.setattr(run, "ChildProcess", lambda *words, **options: recorder)
    bag = str(tmp_path / "bag")
    assert run.drill(MagicMock(), stop, "rpud run", bag) == ExitCode.DONE
    out, err = capsys.readouterr()
    assert (out, err) == ("", "rpud run: stopped before the recording began: there is no bag\n")


def test_a_recorder_that_is_killed_while_it_starts_leaves_no_bag(tmp_path, capsys):
    code = "import os; os.kill(os.getpid(), 9)"
    recorder = run.ChildProcess([sys.executable, "-c", code], errors_apart=True)
    recorder.join(10.0)
    assert not run._close_recorder(recorder, str(tmp_path / "bag"), early=True)
    line = "rpud run: the recorder was ended by signal 9; there is no bag\n"
    assert capsys.readouterr().err == line
