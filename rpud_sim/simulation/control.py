"""Control of a drill: which share of its commands acts, and what happens when they stop."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.simulation.commands import Command, Drive, MountMotion, WeightOnBit, slot
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.simulation import Simulation

# Time without a sample after which a carried mount is held, where no timeout is set [ns].
HOLD = SECOND // 2


class Control:
    """Commands given to a drill, active in full, in part when they are lost, or not at all.

    When no command arrived for ``command_timeout``, the share that acts falls linearly from 1 to 0
    within ``command_loss_ramp``, and stays there until the next one. Where another simulator
    carries the mount, its samples count, and no other command; without a timeout the mount is held
    after half a second, and the drive continues. ``put`` applies a command.
    """

    def __init__(
        self,
        simulation: Simulation,
        put: Callable[[Command], object],
        settings: Settings,
        active: bool = True,
    ) -> None:
        self._simulation = simulation
        self._put = put
        self._initial = self.given = simulation.applied  # given: the last ones; read-only
        self._last = simulation.time  # time of the last command [ns]
        self._share = 1.0  # share of the commands that acts since the last ``apply_share``
        self.configure(settings)
        self.active = active  # whether commands act; read-only
        # whether commands stopped arriving, so that the watchdog ramps them to zero; read-only
        self.commands_lost = False

    def configure(self, settings: Settings) -> None:
        # In nanoseconds, so that the end of the ramp is exact. At least 1: 0 would be no timeout.
        timeout = settings.command_timeout
        self._timeout = max(1, round(timeout * SECOND)) if timeout > 0.0 else 0
        self._ramp = round(settings.command_loss_ramp * SECOND)

    @property
    def next_action_time(self) -> int:
        """Time from which ``apply_share`` changes something without a command [ns]; ``NEVER``."""
        now = self._simulation.time
        if not (self._timeout and self.active):
            due = self._last + HOLD
            if not self._carried or (self.commands_lost and now >= due):
                return NEVER
            return now if self.commands_lost else max(due, now)
        overdue = now - self._last - self._timeout
        if overdue <= 0:
            return now if self.commands_lost else self._last + self._timeout
        return NEVER if self.commands_lost and self._share == 0.0 else now

    @property
    def _carried(self) -> bool:
        """Whether samples have to come for a mount that moves, and nothing else reports when."""
        motion = self.given.motion
        moves = isinstance(motion, MountMotion) and motion.velocity != 0.0
        return moves and self.active and not self._timeout

    def activate(self, active: bool) -> None:
        """Let commands act from now on, starting with the initial ones, or let none act."""
        if active and not self.active:
            self.given = self._initial
            self._last = self._simulation.time
        self.active = active
        self.apply_share()

    def take_over(self) -> None:
        """Take the commands active as given now, and let commands act from now on."""
        self.given = self._simulation.applied
        self._last = self._simulation.time
        self.active = True
        self.commands_lost = False

    def apply(self, command: Command) -> None:
        """Take a command, which is active now unless none acts."""
        if not self.active:
            return
        if isinstance(command, Drive):
            command = command.after(self.given.drive)
        self._put(command)
        if isinstance(command, MountMotion) or not isinstance(self.given.motion, MountMotion):
            self._last = self._simulation.time  # a carried mount is lost with its samples alone
        given: dict[str, Any] = {slot(command): command}
        self.given = dataclasses.replace(self.given, **given)

    def apply_share(self) -> bool:
        """Apply the current share; return whether commands were lost or came back."""
        simulation, given = self._simulation, self.given
        mount = simulation.process.mount
        overdue = simulation.time - self._last - self._timeout if self._timeout else 0
        share = float(self.active)
        if self.active and overdue > 0:
            share = max(0.0, 1.0 - overdue / self._ramp) if self._ramp else 0.0
        self._share = share
        held = self._carried and simulation.time - self._last >= HOLD
        if held and mount:
            self._put(MountMotion(mount.position))
        elif given.motion and mount:
            self._put(given.motion.left(share, mount.position))
        else:
            self._put(WeightOnBit(given.weight_on_bit.force * share))
        if share and given.drive.enabled:
            self._put(Drive(True, given.drive.voltage * share, given.drive.frequency))
        elif simulation.applied.drive.enabled:
            self._put(dataclasses.replace(given.drive, enabled=False))
        before = self.commands_lost
        self.commands_lost = held or (self.active and overdue > 0)
        return self.commands_lost is not before
