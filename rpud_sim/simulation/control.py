"""What is commanded, and how much of it acts: nothing while inactive or when commands are lost."""

from __future__ import annotations

from rpud_sim.simulation.commands import Applied, Drive, WeightOnBit
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.watchdog import CommandWatchdog


class Control:
    """The commands between whoever gives them and the drill.

    Args:
        initial: commands that act until the first one.
        timeout: of the watchdog [s].
        ramp: of the watchdog [s].
        active: whether commands act.
        time: simulation time from which the watchdog waits [ns].
    """

    def __init__(
        self, initial: Applied, timeout: float, ramp: float, active: bool = True, time: int = 0
    ) -> None:
        self._initial = initial
        self._weight_on_bit = initial.weight_on_bit
        self._drive = initial.drive
        self._watchdog = CommandWatchdog(timeout, ramp, time)
        self._active = active
        self._lost = False

    @property
    def active(self) -> bool:
        """Whether commands act."""
        return self._active

    @property
    def commands_lost(self) -> bool:
        """Whether commands stayed out, and the drill is made safe."""
        return self._lost

    def set(self, timeout: float, ramp: float) -> None:
        """Take another timeout and ramp [s]."""
        self._watchdog.set(timeout, ramp)

    def activate(self, active: bool, time: int) -> None:
        """Let commands act from a simulation time [ns] on, from the initial ones, or let none."""
        if active and not self._active:
            self._weight_on_bit = self._initial.weight_on_bit
            self._drive = self._initial.drive
            self._watchdog.heard(time)
        self._active = active

    def take(self, command: WeightOnBit | Drive, simulation: Simulation) -> None:
        """Take a command: it acts now, if commands do."""
        if not self._active:
            return
        self._watchdog.heard(simulation.time)
        if isinstance(command, WeightOnBit):
            self._weight_on_bit = command
        else:
            before = self._drive
            self._drive = Drive(
                command.enabled,
                command.voltage if command.enabled or command.voltage else before.voltage,
                command.frequency or before.frequency,
            )
        simulation.apply(command)

    def act(self, simulation: Simulation) -> bool:
        """Let act what shall act now; tell whether commands were lost or came back."""
        time = simulation.time
        share = self._watchdog.share(time) if self._active else 0.0
        weight_on_bit = WeightOnBit(self._weight_on_bit.force * share)
        if weight_on_bit != simulation.applied.weight_on_bit:
            simulation.apply(weight_on_bit)
        drive = self._drive
        if share == 0.0 or not drive.enabled:
            if simulation.applied.drive.enabled:
                simulation.apply(Drive(False, 0.0, 0.0))
        else:
            drive = Drive(True, drive.voltage * share, drive.frequency)
            if drive != simulation.applied.drive:
                simulation.apply(drive)
        before, self._lost = self._lost, self._active and self._watchdog.lost(time)
        return self._lost is not before
