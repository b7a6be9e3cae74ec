"""Faults of a drill, as a client injects, clears and lists them."""

from __future__ import annotations

import math

from rpud_msgs.msg import Fault
from rpud_msgs.srv import ClearFault, InjectFault, ListFaults

from rpud_sim.foundation.quantities import did_you_mean, shown
from rpud_sim.ros.client.arguments import FAULT_NUMBER, to_duration, to_number, to_text
from rpud_sim.ros.client.client_part import ClientPart
from rpud_sim.ros.client.errors import RefusedError


class FaultServices(ClientPart):
    """Faults of a drill; a call returns when the topic ``faults`` shows the change."""

    @property
    def faults(self) -> list[Fault]:
        """Faults since the start, those that last and those that are over, by number."""
        self._drill.find()
        faults = self._drill.until(lambda: self._drill.watch.faults, "no list of faults came")
        assert faults is not None  # until waits for it
        return list(faults.faults)

    def inject(
        self,
        kind: str,
        channel: str = "",
        magnitude: float | None = None,
        duration: float | None = None,
    ) -> int:
        """Inject a fault, such as ``free_mass_jammed``, and return its number.

        ``channel`` is the relative name of the topic with the faulty signal; empty for the physics.
        The magnitude is in the unit of the kind; None for its default. After a duration in
        simulation time [s] it ends by itself; None for never.
        """
        fault = Fault(
            kind=to_text("kind", kind),
            channel=to_text("channel", channel),
            magnitude=math.nan if magnitude is None else to_number("magnitude", magnitude),
        )
        length = to_duration("duration", 0.0 if duration is None else duration)
        request = InjectFault.Request(fault=fault, duration=length)
        response = self._drill.call("inject_fault", request)
        if not response.success:
            raise RefusedError(response.message)
        number = int(response.number)
        self._drill.until(
            lambda: any(each.number == number for each in self.faults),
            f"the topic faults did not show fault {number}",
        )
        return number

    def clear(self, which: int | str = "all") -> list[int]:
        """End active faults now: ``which`` is a number, a kind or ``all``. Return their numbers."""
        numbers = self._active(which)
        for number in [0] if which == "all" else numbers:
            response = self._drill.call("clear_fault", ClearFault.Request(number=number))
            if not response.success:
                raise RefusedError(response.message)
        self._drill.until(
            lambda: not any(each.active and each.number in numbers for each in self.faults),
            "the topic faults did not show the end",
        )
        return numbers

    def list_faults(self) -> ListFaults.Response:
        """Return the active faults, and the kinds and channels that can be injected now."""
        return self._drill.call("list_faults", ListFaults.Request(), repeat=True)

    def _active(self, which: int | str) -> list[int]:
        if not isinstance(which, str):
            return [int(FAULT_NUMBER.check("fault", which))]
        active = self.list_faults().faults
        numbers = [int(each.number) for each in active if which in ("all", each.kind)]
        if not numbers and which != "all":
            if not active:
                raise RefusedError("no fault is active")
            hint = did_you_mean(which, sorted({each.kind for each in active}))
            raise RefusedError(f"no fault {shown(which)} is active; {hint}")
        return numbers
