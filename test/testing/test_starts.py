"""Many starts of a node as the pages show it: no first command and no first call is lost.

`make starts` makes STARTS of each beside busy loops.
"""

import os
from pathlib import Path

import pytest

from rpud_sim.testing.setup import drill_setup

STARTS = int(os.environ.get("RPUD_STARTS", "30"))


@pytest.mark.extended
@pytest.mark.timeout(0)
@pytest.mark.parametrize(
    ("node", "answers", "keep"),
    [
        ("commander.py commands", "command/weight_on_bit", ""),
        ("commander.py calls", "command/weight_on_bit", ""),
        ("resting.py leaves", "resting/answer", "resting/leave"),
    ],
)
def test_no_start_loses_the_first_command_or_call(pool, node, answers, keep):
    lost, processes = [], set()
    for number in range(STARTS):
        drill = pool.take(drill_setup({}), Path(__file__).parent)
        drill.with_answers(answers)
        command = f"python ../helpers/{node}"
        try:
            process = drill.start(command, subscribes_to=("reacting_force",), keep=keep)
            processes.add(process.pid)
            drill.step(0.2)
            assert drill.status.commands_accepted == 2
        except AssertionError as error:
            lost.append(f"{number}: {error}")
        pool.give_back(drill)
    assert lost == []
    assert (len(processes) == 1) == bool(keep)
