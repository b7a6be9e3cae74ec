"""Process of a drill in lockstep, in a ROS domain of its own."""

from __future__ import annotations

import shutil
import signal
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from rpud_sim.foundation.child_process import ChildProcess
from rpud_sim.testing.domains import DomainClaim, loopback_environment

# Parameters of every drill of a test: time stands still between steps, and begins at zero.
LOCKSTEP: Mapping[str, bool] = {"start_paused": True, "publish_clock": True}

NO_FAULTS = "faults: []\n"
_PROGRAM = "from rpud_sim.cli.executables import drill_node; drill_node()"


class DrillProcess:
    """Drill node that has just been started, in a domain that it has claimed.

    It reads its scenario again at each reset: a file that the owner may write before.
    """

    def __init__(self, parameters: Mapping[str, Any], namespace: str) -> None:
        self.namespace = namespace
        self.folder = Path(tempfile.mkdtemp(prefix="rpud_drill_"))
        self._claim = DomainClaim()
        self.scenario = self.folder / "scenario.yaml"
        self.scenario.write_text(NO_FAULTS)
        values = {**parameters, **LOCKSTEP, "scenario": str(self.scenario)}
        file = self.folder / "parameters.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": _to_ros(values)}}))
        self.environment = {
            **loopback_environment(self._claim.domain),
            "ROS_LOG_DIR": str(self.folder / "log"),
            "PYTHONUNBUFFERED": "1",
        }
        self.process = ChildProcess(
            (
                *(sys.executable, "-c", _PROGRAM, "--ros-args"),
                *("-r", f"__ns:={namespace}", "--params-file", str(file)),
            ),
            environment=self.environment,
            folder=self.folder,
        )

    @property
    def domain(self) -> int:
        return self._claim.domain

    def stop(self) -> None:
        """End it, and leave the domain to others."""
        self.process.end(signal.SIGINT)
        self._claim.release()
        shutil.rmtree(self.folder, ignore_errors=True)


def _to_ros(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters as the node declares them: every number is a floating-point number."""
    return {
        name: float(value) if isinstance(value, int) and not isinstance(value, bool) else value
        for name, value in values.items()
    }
