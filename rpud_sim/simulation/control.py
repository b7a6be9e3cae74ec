"""Control: the share of the commands that acts, less when they are lost, none while inactive."""

from __future__ import annotations

from rpud_sim.drilling.mount import STOPPED
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.simulation import Simulation


class CommandWatchdog:
    """Share of the commands that acts, by the time of the last one.

    The share is 1 while commands arrive. When none arrived for the timeout, it falls linearly to 0
    within the ramp, and stays there until the next command. Times are integer nanoseconds of
    simulation time.

    Args:
        timeout: time without a command after which commands are lost [s]; 0 for never.
        ramp: time in which the share falls from 1 to 0 [s].
        time: at which it starts.
    """

    def __init__(self, timeout: float, ramp: float, time: int = 0) -> None:
        self._last = time
        self.set(timeout, ramp)

    def set(self, timeout: float, ramp: float) -> None:
        """Set another timeout and ramp [s]."""
        # In nanoseconds, so that the end of the ramp is exact. At least 1: 0 would be no timeout.
        self._timeout = max(1, round(timeout * SECOND)) if timeout > 0.0 else 0
        self._ramp = round(ramp * SECOND)

    def reset(self, time: int) -> None:
        """Wait again from the time of a command on."""
        self._last = time

    def lost(self, time: int) -> bool:
        """Return whether commands are lost."""
        return self._overdue(time) > 0

    def share(self, time: int) -> float:
        """Return the share of the commands that acts, from 1 to 0."""
        overdue = self._overdue(time)
        if overdue <= 0:
            return 1.0
        return max(0.0, 1.0 - overdue / self._ramp) if self._ramp else 0.0

    def _overdue(self, time: int) -> int:
        return time - self._last - self._timeout if self._timeout else 0


class Control:
    """Commands of a drill, put into force in full, in part when they are lost, or not at all.

    Args:
        simulation: at its start; the commands in force there are the initial ones.
    """

    def __init__(
        self, simulation: Simulation, timeout: float, ramp: float, active: bool = True
    ) -> None:
        self._simulation = simulation
        self._initial = simulation.applied
        self._weight_on_bit = self._initial.weight_on_bit
        self._drive = self._initial.drive
        self._feed = self._initial.feed
        self._watchdog = CommandWatchdog(timeout, ramp, simulation.time)
        self._active = active
        self._lost = False

    @property
    def active(self) -> bool:
        """Whether commands act."""
        return self._active

    @property
    def commands_lost(self) -> bool:
        """Whether commands stopped arriving, so that the watchdog makes the drill safe."""
        return self._lost

    def set(self, timeout: float, ramp: float) -> None:
        """Set another timeout and ramp [s]."""
        self._watchdog.set(timeout, ramp)

    def activate(self, active: bool) -> None:
        """Let commands act from now on, starting with the initial ones, or let none act."""
        if active and not self._active:
            self._weight_on_bit = self._initial.weight_on_bit
            self._drive = self._initial.drive
            self._feed = self._initial.feed
            self._watchdog.reset(self._simulation.time)
        self._active = active
        self.act()

    def adopt(self) -> None:
        """Take the commands in force as given now, and let commands act from now on."""
        applied = self._simulation.applied
        self._weight_on_bit = applied.weight_on_bit
        self._drive = applied.drive
        self._feed = applied.feed
        self._watchdog.reset(self._simulation.time)
        self._active = True
        self._lost = False

    def apply(self, command: WeightOnBit | Drive | Feed) -> None:
        """Put a command into force now, if commands act.

        Raises:
            ParameterError: if the drill cannot take it; nothing changes then.
        """
        if not self._active:
            return
        if isinstance(command, Feed):
            self._simulation.configuration.check_feed(command)
        elif isinstance(command, WeightOnBit):
            self._simulation.configuration.check_weight_on_bit()
        self._watchdog.reset(self._simulation.time)
        if isinstance(command, WeightOnBit):
            self._weight_on_bit = command
        elif isinstance(command, Feed):
            self._feed = command
        else:
            command = self._drive = command.after(self._drive)
        self._simulation.apply(command)

    def act(self) -> bool:
        """Put the present share into force; return whether commands were lost or came back."""
        simulation = self._simulation
        time = simulation.time
        share = self._watchdog.share(time) if self._active else 0.0
        if simulation.configuration.has_feed:
            feed = self._feed.reduced(share) if share else STOPPED
            if feed != simulation.applied.feed:
                simulation.apply(feed)
        else:
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
