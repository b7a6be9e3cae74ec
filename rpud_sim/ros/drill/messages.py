"""Conversions between plain fields of ``rpud_sim.simulation.fields`` and ROS messages.

Stamps and origins, the stamp of simulation time zero, are integer nanoseconds.
"""

from __future__ import annotations

import math
from typing import TypeVar

from builtin_interfaces.msg import Time
from rpud_msgs.msg import Fault as FaultMessage

from rpud_sim.simulation import fields
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.ledger import FaultRecord

Message = TypeVar("Message")


def filled(message: Message, values: fields.Fields) -> Message:
    """Set the message's fields, and those of the messages in it, and return it."""
    for name, value in values.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def nanoseconds_to_time(nanoseconds: int) -> Time:
    """Convert integer nanoseconds to a ``builtin_interfaces/Time``."""
    return filled(Time(), fields.time_fields(nanoseconds))


def message_to_fault(message: FaultMessage) -> Fault:
    """Convert a fault to inject.

    A magnitude of zero, which an unfilled message holds, stands for the kind's default unless the
    kind permits zero.
    """
    kind = KINDS.get(message.kind)
    unfilled = message.magnitude == 0.0 and kind is not None and not kind.takes_zero
    return Fault(message.kind, message.channel, math.nan if unfilled else message.magnitude)


def record_to_fault(record: FaultRecord, origin: int) -> FaultMessage:
    return filled(FaultMessage(), fields.fault_fields(record, origin))
