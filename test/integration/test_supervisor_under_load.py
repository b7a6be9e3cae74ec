"""The supervisor of the examples on a machine that keeps it waiting."""

from pathlib import Path

import pytest
from support import until

SUPERVISOR = Path(__file__).parents[2] / "examples" / "supervisor.py"


@pytest.mark.extended
@pytest.mark.rpud(regime="free", drive_enabled=False, weight_on_bit=0.0, telemetry_rate=50.0)
def test_a_drive_that_starts_late_is_no_reason_to_retreat(drill):
    command = f"python {SUPERVISOR} --ros-args -r __ns:={drill.namespace}"
    supervisor = drill.start(command, subscribes_to=("wrench",), ready="the drill is there")
    supervisor.pause()
    drill.step(3.5)  # it hears this before it hears of the drive that it switches on
    supervisor.resume()
    until(lambda: "ramping" in supervisor.output)
    drill.with_answers("command/drive", "command/weight_on_bit")
    drill.step(1.0)
    assert drill.status.drive_enabled, supervisor.output
    assert drill.status.weight_on_bit > 0.0
