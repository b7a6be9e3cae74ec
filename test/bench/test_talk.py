"""The processes of a measurement end with it, those too that ignore an interrupt."""

import os
import signal

from bench.talk import Talk, end, ros


def stopped():
    talk = Talk({})
    os.kill(talk._process.pid, signal.SIGSTOP)
    os.waitpid(talk._process.pid, os.WUNTRACED)
    return talk


def test_a_drill_that_does_not_end_is_killed_and_counted(capsys):
    with ros():
        talks = [stopped()]
        assert end(talks, 0.1) == 1
    assert "1 of 1 drills killed" in capsys.readouterr().err
    assert talks[0]._process.returncode == -signal.SIGKILL
