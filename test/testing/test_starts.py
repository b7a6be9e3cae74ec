"""Many starts of a node as the documents show it: no first command and no first call is lost.

`make starts` makes STARTS of each beside busy loops.
"""

import os
from pathlib import Path

import pytest

from rpud_sim.testing.setup import drill_setup

STARTS = int(os.environ.get("RPUD_STARTS", "30"))


@pytest.mark.extended
@pytest.mark.timeout(0)
@pytest.mark.parametrize("how", ["commands", "calls"])
def test_no_start_loses_the_first_command_or_call(pool, how):
    lost = []
    for number in range(STARTS):
        drill = pool.take(drill_setup({}), Path(__file__).parent)
        drill.with_answers("command/weight_on_bit")
        try:
            drill.start(f"python ../helpers/commander.py {how}", subscribes_to=("reacting_force",))
            drill.step(0.2)
            assert drill.status.commands_accepted == 2
        except AssertionError as error:
            lost.append(f"{number}: {error}")
        pool.give_back(drill)
    assert lost == []
