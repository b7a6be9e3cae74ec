"""Record of a run: what was published and commanded, in an order that no load changes.

Two commands of one step may reach the drill in either order. Both take effect at the same instant
of simulation time, so only two things show the order: the numbers in the journal, and the status
between the two. The record has the last status of each instant alone.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.serialization import deserialize_message

from rpud_sim.testing.drill import Drill
from rpud_sim.testing.heard_topic import HeardTopic

# Of a status: how fast the drill was on this machine, and what it had discovered.
_OF_THE_MACHINE = (
    "commanders",
    "deadlines_missed",
    "messages_dropped",
    "real_time_factor",
    "lateness_max",
    "lag",
)


@dataclasses.dataclass(frozen=True)
class KeptTopic:
    """Messages of a topic in a run; as ``HeardTopic``, but without its subscription."""

    kind: Any  # class of the messages
    latched: bool  # whether it is transient local
    lost: int  # messages that were lost
    stamps: Sequence[int]  # of the messages [ns]
    payloads: Sequence[bytes]  # the messages, serialized


@dataclasses.dataclass(frozen=True)
class RunRecord:
    """Everything that was published in a run."""

    namespace: str  # of the drill
    heard: Mapping[str, KeptTopic]  # topics by absolute name

    def digest(self) -> str:
        """Return a digest of what was published and commanded, by simulation time."""
        digest = hashlib.sha256()
        for name, topic in sorted(self.heard.items()):
            content = [
                _content(name.removeprefix(f"{self.namespace}/"), topic.kind, stamp, payload)
                for stamp, payload in zip(topic.stamps, topic.payloads, strict=True)
            ]
            content.sort(key=lambda entry: entry[0])
            digest.update(f"{name} {len(content)}\n".encode())
            for stamp, same in _by_stamp(content):
                digest.update(f"{stamp} ".encode())
                for payload in sorted(same):
                    digest.update(payload)
        return digest.hexdigest()


def run_record(drill: Drill) -> RunRecord:
    """Return the record of a drill's run so far."""
    status = f"{drill.namespace}/status"
    return RunRecord(
        drill.namespace,
        {name: _kept(topic, name == status) for name, topic in sorted(drill.heard.items())},
    )


def _kept(topic: HeardTopic, last_only: bool) -> KeptTopic:
    stamps, payloads = list(topic.stamps), list(topic.payloads)
    if last_only:
        chosen = dict(zip(stamps, payloads, strict=True))
        stamps, payloads = list(chosen), list(chosen.values())
    return KeptTopic(topic.kind, topic.latched, topic.lost, stamps, payloads)


def _content(name: str, kind: Any, stamp: int, payload: bytes) -> tuple[int, bytes]:
    """Return a message's time and what counts of it."""
    if name == "status":
        message = deserialize_message(payload, kind)
        fields = {
            field: repr(getattr(message, field))
            for field in message.get_fields_and_field_types()
            if field not in _OF_THE_MACHINE
        }
        return stamp, json.dumps(fields).encode()
    if name == "journal":
        message = deserialize_message(payload, kind)
        return stamp, f"{message.kind} {_without_machine(message.content)}".encode()
    return stamp, payload


def _without_machine(content: str) -> str:
    """Return a journal entry without the path of the scenario, which differs each time."""
    entry = json.loads(content)
    if isinstance(entry.get("parameters"), dict):
        entry["parameters"].pop("scenario", None)
    return json.dumps(entry, sort_keys=True)


def _by_stamp(content: Sequence[tuple[int, bytes]]) -> list[tuple[int, list[bytes]]]:
    found: dict[int, list[bytes]] = {}
    for stamp, payload in content:
        found.setdefault(stamp, []).append(payload)
    return list(found.items())
