"""Control of a drill: which commands act, and what the watchdog does when they stop."""

from __future__ import annotations

import dataclasses
from typing import Any

from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.simulation.commands import (
    Command,
    Drive,
    MountMotion,
    WeightOnBit,
    slot,
)
from rpud_sim.simulation.simulation import Simulation


class Control:
    """Commands of a drill, put into force in full, in part when they are lost, or not at all.

    When no command arrived for the timeout [s], 0 for never, the share that acts falls linearly
    from 1 to 0 within the ramp [s], and stays there until the next one. Where another simulator
    carries the mount, its samples count, and no other command.
    """

    def __init__(
        self, simulation: Simulation, timeout: float, ramp: float, active: bool = True
    ) -> None:
        self.simulation = simulation
        self._initial = self._given = simulation.applied
        self._last = simulation.time  # of the last command [ns]
        self.set(timeout, ramp)
        self.active = active  # whether commands act; read-only
        # whether commands stopped arriving, so that the watchdog makes the drill safe; read-only
        self.commands_lost = False

    def set(self, timeout: float, ramp: float) -> None:
        # In nanoseconds, so that the end of the ramp is exact. At least 1: 0 would be no timeout.
        self._timeout = max(1, round(timeout * SECOND)) if timeout > 0.0 else 0
        self._ramp = round(ramp * SECOND)

    @property
    def quiet_until(self) -> int:
        """Time until which ``act`` changes nothing without a command [ns]; ``NEVER`` for ever."""
        if not (self._timeout and self.active):
            return NEVER
        now = self.simulation.time
        overdue = now - self._last - self._timeout
        if overdue <= 0:
            return now if self.commands_lost else self._last + self._timeout
        return NEVER if self.commands_lost and overdue > self._ramp else now

    def activate(self, active: bool) -> None:
        """Let commands act from now on, starting with the initial ones, or let none act."""
        if active and not self.active:
            self._given = self._initial
            self._last = self.simulation.time
        self.active = active
        self.act()

    def adopt(self) -> None:
        """Take the commands in force as given now, and let commands act from now on."""
        self._given = self.simulation.applied
        self._last = self.simulation.time
        self.active = True
        self.commands_lost = False

    def apply(self, command: Command) -> None:
        if not self.active:
            return
        if isinstance(command, Drive):
            command = command.after(self._given.drive)
        elif isinstance(command, MountMotion):
            command = command.acting(self.simulation.time)
        self.simulation.apply(command)
        if isinstance(command, MountMotion) or not isinstance(self._given.motion, MountMotion):
            self._last = self.simulation.time  # a carried mount is lost with its samples alone
        given: dict[str, Any] = {slot(command): command}
        self._given = dataclasses.replace(self._given, **given)

    def act(self) -> bool:
        """Put the present share into force; return whether commands were lost or came back."""
        simulation, given = self.simulation, self._given
        mount = simulation.process.mount
        overdue = simulation.time - self._last - self._timeout if self._timeout else 0
        share = float(self.active)
        if self.active and overdue > 0:
            share = max(0.0, 1.0 - overdue / self._ramp) if self._ramp else 0.0
        if given.motion and mount:
            simulation.apply(given.motion.left(share, mount.position))
        else:
            simulation.apply(WeightOnBit(given.weight_on_bit.force * share))
        if share and given.drive.enabled:
            simulation.apply(Drive(True, given.drive.voltage * share, given.drive.frequency))
        elif simulation.applied.drive.enabled:
            simulation.apply(dataclasses.replace(given.drive, enabled=False))
        before = self.commands_lost
        self.commands_lost = self.active and overdue > 0
        return self.commands_lost is not before
