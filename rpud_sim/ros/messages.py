"""From the plain fields of ``rpud_sim.simulation.fields`` to ROS messages.

Stamps and origins, the stamp of simulation time zero, are integer nanoseconds.
"""

from __future__ import annotations

from typing import TypeVar

from builtin_interfaces.msg import Time
from rpud_msgs.msg import Fault, Faults

from rpud_sim.simulation import fields
from rpud_sim.simulation.ledger import FaultRecord
from rpud_sim.simulation.ledger import Faults as FaultLedger

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


def record_to_fault(record: FaultRecord, origin: int) -> Fault:
    """Convert one record of the ledger."""
    return filled(Fault(), fields.fault_fields(record, origin))


def faults_to_message(ledger: FaultLedger, time: int, origin: int) -> Faults:
    """Convert the ledger as it is at a simulation time."""
    message = filled(Faults(), fields.faults_header_fields(ledger, time, origin))
    message.faults = [record_to_fault(record, origin) for record in ledger.records]
    return message
