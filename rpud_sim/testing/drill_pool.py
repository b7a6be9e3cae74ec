"""Drills that are kept between tests. It imports nothing heavy before a drill is taken."""

from __future__ import annotations

import atexit
import contextlib
import gc
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.ros.environment import StartError
from rpud_sim.testing.errors import DrillError
from rpud_sim.testing.processes import DrillProcess

if TYPE_CHECKING:
    from rpud_sim.testing.drill import LockstepDrill
    from rpud_sim.testing.setup import DrillSetup

_MOST_IDLE = 3  # drills that are kept: each takes some 200 MB


def check_ros() -> None:
    """Raise a DrillError that shows what to install where ROS 2 cannot be imported."""
    try:
        import_module("rclpy")
        import_module("rpud_msgs.msg")
    except ImportError as error:
        raise DrillError(
            f"a drill of a test needs ROS 2 Jazzy ({error}): pip install 'rpud_sim[ros]', or "
            "source /opt/ros/jazzy/setup.bash and the workspace with rpud_msgs"
        ) from None
    except StartError as error:
        raise DrillError(f"a drill of a test needs ROS 2 Jazzy: {error}") from None


class DrillPool:
    """Drills of one process of tests; the first one's process imports while this one does."""

    def __init__(self) -> None:
        self._idle: list[LockstepDrill] = []
        self._waiting: DrillProcess | None = DrillProcess()
        # At its end Python else searches all that is left for cycles, which takes 0.1 s.
        atexit.register(gc.freeze)

    def take(self, setup: DrillSetup, folder: Path | None = None) -> LockstepDrill:
        """Return a drill at time zero, as if just started; commands start in ``folder``."""
        parameters = sorted(f"{name}={value!r}" for name, value in setup.parameters.items())
        key = (setup.namespace, *parameters)
        own = [each for each in self._idle if each.key[0] == setup.namespace]
        for drill in sorted(own, key=lambda each: each.key != key):
            self._idle.remove(drill)
            try:
                if drill.key != key:
                    drill.renew(setup.all_parameters)
                    drill.key = key
                drill.begin(setup.seed, setup.scenario)
            except DrillError:  # it has died, or does not come back: another one takes its place
                drill.close()
            else:
                drill.folder = folder
                return drill
        process, self._waiting = self._waiting or DrillProcess(), None
        process.start(setup.parameters, setup.namespace)
        from rpud_sim.testing.drill import LockstepDrill  # with all of ROS

        drill = LockstepDrill(process, folder)
        drill.key = key
        try:
            drill.begin(setup.seed, setup.scenario)
        except BaseException:
            drill.close()
            raise
        return drill

    def give_back(self, drill: LockstepDrill) -> None:
        """Keep a drill for the next test; its processes under test end."""
        if not drill.alive:
            drill.close()
            return
        drill.end()
        self._idle.append(drill)
        while len(self._idle) > _MOST_IDLE:
            self._idle.pop(0).close()

    def interrupt(self) -> None:
        """Have all drills end, without a wait for that."""
        for drill in self._idle:
            drill.interrupt()

    def close(self) -> None:
        """End all drills."""
        self.interrupt()
        while self._idle:
            self._idle.pop().close()
        if self._waiting is not None:
            self._waiting.stop()
            self._waiting = None


@contextlib.contextmanager
def open_drill(folders: Sequence[Path] = (), **options: Any) -> Iterator[LockstepDrill]:
    """Start a drill in lockstep, and end it: for test runners other than pytest.

    ``folders`` are those in which relative paths are looked for; commands start in the first one.
    Options are as in the mark ``rpud``.
    """
    with contextlib.closing(DrillPool()) as pool:
        check_ros()
        from rpud_sim.testing.setup import drill_setup

        setup = drill_setup(options, folders)
        with contextlib.closing(pool.take(setup, folders[0] if folders else None)) as drill:
            yield drill
