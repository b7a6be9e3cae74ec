"""Metadata of a bag. Times and durations are integer nanoseconds.

The metadata of rosbag2, version 9 (Jazzy), is stored twice: in ``metadata.yaml`` under one outer
key, and without that key in the MCAP file's metadata record ``rosbag2``. rosbag2 fails if a field
is missing, so every field is always written. Further records have losses, the origin of runs and
the verdict of a test.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from rpud_sim.bag.limits import RECORD_LIMIT
from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.terminal import error_text
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.user_files import read_file
from rpud_sim.messages.definition_text import structure_of
from rpud_sim.messages.errors import MALFORMED, BagFormatError, parsing

FILE_NAME = "metadata.yaml"
RECORD_NAME = "rosbag2"
RECORD_KEY = "serialized_metadata"
OFFERED_QOS_KEY = "offered_qos_profiles"  # key in the metadata of a channel
VERSION = 9

LOSSES_RECORD = "rpud_losses"  # metadata record with the ``Losses`` of each topic
# Metadata record with the duration that a recorder loses at most if it is killed: ``max_loss`` [s].
RECORDING_RECORD = "rpud_recording"

INFINITE = 2**63 - 1  # unlimited duration [ns]; in YAML ``sec: 9223372036``, ``nsec: 854775807``

# Fewer messages have no rate: two that arrive together would have one of many kHz.
RATE_MESSAGES = 10

_LONG_NUMBER = re.compile(r"[-+0-9_.:]{65,}")  # sexagesimal ones, ``1:1:1``, take very long
_DEEPEST = 100  # levels of metadata; rosbag2 writes 8
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
_OUTER_KEY = "rosbag2_bagfile_information"

# Policies of quality of service: rosbag2 wrote the index until version 8, and the word since.
_POLICIES = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown", "best_available"),
    "durability": ("system_default", "transient_local", "volatile", "unknown", "best_available"),
    "liveliness": (
        *("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown"),
        "best_available",
    ),
}
_DURATIONS = ("deadline", "lifespan", "liveliness_lease_duration")


@dataclass(frozen=True)
class QosProfile:
    """Quality of service that one publisher offers, in rosbag2's words.

    Discovery does not carry history and depth: recorded offers have ``unknown`` and 0.
    """

    history: str = "unknown"  # policy
    depth: int = 0  # depth of the history
    reliability: str = "reliable"  # policy
    durability: str = "volatile"  # policy
    deadline: int = INFINITE  # [ns]
    lifespan: int = INFINITE  # [ns]
    liveliness: str = "automatic"  # policy
    liveliness_lease_duration: int = INFINITE  # [ns]
    avoid_ros_namespace_conventions: bool = False  # whether the topic's name is used as it is

    def to_mapping(self) -> dict[str, Any]:
        """Return the fields as in rosbag2's YAML."""
        return {
            name: {"sec": value // SECOND, "nsec": value % SECOND} if name in _DURATIONS else value
            for name, value in vars(self).items()
        }


def _profile(item: Mapping[str, Any]) -> QosProfile:
    """Return the profile of a YAML mapping; what it lacks is as by default."""
    item = {**QosProfile().to_mapping(), **item}
    values: dict[str, Any] = {}
    for name, words in _POLICIES.items():
        word = item[name]
        if isinstance(word, int):
            word = words[word] if 0 <= word < len(words) else "unknown"
        values[name] = word if word in words else "unknown"
    for name in _DURATIONS:
        duration = int(item[name]["sec"]) * SECOND + int(item[name]["nsec"])
        # Older middlewares wrote other values for "unlimited", all of them longer than 68 years.
        values[name] = INFINITE if duration >= 0x7FFFFFFF * SECOND else duration
    plain = bool(item["avoid_ros_namespace_conventions"])
    return QosProfile(depth=int(item["depth"]), avoid_ros_namespace_conventions=plain, **values)


@dataclass(frozen=True)
class Topic:
    """Recorded topic."""

    name: str  # absolute name
    type: str  # such as ``std_msgs/msg/Header``
    type_hash: str = ""  # ``RIHS01_...`` hash of the type; empty if it is unknown
    offered_qos: tuple[QosProfile, ...] = ()  # quality of service of each publisher
    serialization_format: str = "cdr"  # serialization of the messages


@dataclass(frozen=True)
class Losses:
    """Numbers of lost messages of one topic."""

    # lost on the way to the recorder; None if the middleware does not number messages
    transport: int | None = 0
    queue: int = 0  # dropped because the recorder's queue was full
    damaged: int = 0  # arrived with unreadable data or an impossible time

    @property
    def total(self) -> int | None:
        """All lost messages; None if that is unknown."""
        return None if self.transport is None else self.transport + self.queue + self.damaged


@dataclass(frozen=True)
class TopicSummary:
    """Content of a bag, or of one file, for one topic."""

    # name, type and encoding of the first channel, and what all publishers offered
    topic: Topic
    message_count: int  # messages of the topic
    # log time of the first message [ns]; None without messages or without an index
    first_time: int | None
    last_time: int | None  # log time of the last message [ns]; None as for ``first_time``
    definition: str | None  # ``ros2msg`` text of the type; None if the file has no such text
    losses: Losses | None = None  # messages that the recorder lost; None if they were not counted
    # encoding, type and definition of all channels
    kinds: frozenset[tuple[str, str, str]] = frozenset()
    undefined: str = ""  # reason why there is no definition; empty if there is one

    @classmethod
    def joined(cls, parts: Sequence[TopicSummary], losses: Losses | None) -> TopicSummary:
        """Return the summary of several files from theirs."""
        times = [time for part in parts for time in (part.first_time, part.last_time)]
        known = [time for time in times if time is not None]
        return cls(
            topic=parts[0].topic,
            message_count=sum(part.message_count for part in parts),
            first_time=min(known, default=None),
            last_time=max(known, default=None),
            definition=parts[0].definition,
            undefined=parts[0].undefined,
            losses=losses,
            kinds=frozenset().union(*(part.kinds for part in parts)),
        )

    @property
    def one_type(self) -> bool:
        """Whether all its messages have one type; definitions may differ in form."""
        if len(self.kinds) < 2:
            return True
        return len({(coding, *structure_of(*kind)) for coding, *kind in self.kinds}) == 1

    @property
    def types(self) -> tuple[str, ...]:
        """Names of the types of its messages; a bag may have several on one topic."""
        return tuple(sorted({name for _, name, _ in self.kinds}))

    @property
    def rate(self) -> float | None:
        """Mean rate from the first to the last message [Hz].

        None if there are fewer than ``RATE_MESSAGES``, or their times are unknown or equal.
        """
        if self.first_time is None or self.last_time is None:
            return None
        if self.message_count < RATE_MESSAGES or self.last_time <= self.first_time:
            return None
        return (self.message_count - 1) * 1e9 / (self.last_time - self.first_time)


class FileInformation(NamedTuple):
    """One storage file of the bag: its name in the bag, time and duration [ns], and messages."""

    path: str
    start_time: int
    duration: int
    message_count: int


class ReadMetadata(NamedTuple):
    """What a reader needs of a bag's metadata, of this or an earlier version."""

    storage_identifier: str
    relative_file_paths: tuple[str, ...]
    compression_mode: str  # mode for whole files or messages; MCAP chunks have another one
    message_counts: Mapping[str, int]  # counts of files, by their paths; empty before version 5


def metadata_of(files: Sequence[FileInformation], counts: Mapping[Topic, int]) -> dict[str, Any]:
    """Return the metadata of a bag with these files, and topics with their message counts."""
    filled = [file for file in files if file.message_count]
    start = min((file.start_time for file in filled), default=0)
    end = max((file.start_time + file.duration for file in filled), default=0)
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        **_extent(start, end - start, sum(file.message_count for file in files)),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": topic.serialization_format,
                    "offered_qos_profiles": [qos.to_mapping() for qos in topic.offered_qos],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": count,
            }
            for topic, count in counts.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.path for file in files],
        "files": [{"path": path, **_extent(*extent)} for path, *extent in files],
        "custom_data": {},
        "ros_distro": os.environ.get("ROS_DISTRO") or "jazzy",
    }


def _extent(start: int, duration: int, count: int) -> dict[str, Any]:
    return {
        "duration": {"nanoseconds": duration},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": count,
    }


def dump_document(metadata: Mapping[str, Any]) -> str:
    """Return the text of a ``metadata.yaml``."""
    return dump_yaml({_OUTER_KEY: metadata})


def dump_yaml(value: Any) -> str:
    """Return the text of a metadata record."""
    return str(yaml.dump(value, Dumper=_DUMPER, sort_keys=False, allow_unicode=True))


def metadata_from_document(text: str) -> ReadMetadata:
    """Return the metadata from the text of a ``metadata.yaml``, of this or an earlier version."""
    document = _load(text)
    if not isinstance(document, Mapping) or _OUTER_KEY not in document:
        raise BagFormatError(f"{FILE_NAME} has no {_OUTER_KEY}")
    value = document[_OUTER_KEY]
    with parsing("the rosbag2 metadata"):
        names = value.get("relative_file_paths") or []
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError(f"relative_file_paths is {names!r:.80}, and must be a list of names")
        return ReadMetadata(
            storage_identifier=str(value.get("storage_identifier") or ""),
            relative_file_paths=tuple(names),
            compression_mode=str(value.get("compression_mode") or ""),
            message_counts={
                str(each["path"]): int(each["message_count"]) for each in value.get("files") or ()
            },
        )


def read_document(path: Path) -> ReadMetadata:
    content = read_file(path, RECORD_LIMIT + 1)
    if len(content) > RECORD_LIMIT:
        raise BagFormatError(f"it has more than {RECORD_LIMIT} bytes")
    return metadata_from_document(content.decode("utf-8"))


def dump_offered_qos(profiles: tuple[QosProfile, ...]) -> str:
    """Return the YAML text of the channel metadata ``offered_qos_profiles``."""
    return dump_yaml([profile.to_mapping() for profile in profiles])


def load_offered_qos(text: str) -> tuple[QosProfile, ...]:
    """Return the profiles of such a text, with policies as words or as older numbers."""
    value = _load(text)
    if not value:
        return ()
    if not isinstance(value, list):
        raise BagFormatError(f"offered_qos_profiles is {value!r:.80}; it must be a list")
    with parsing("a profile of offered_qos_profiles"):
        return tuple(map(_profile, value))


def stored_name(path: Path) -> str:
    """Return a file's name for the metadata, in UTF-8 under every locale."""
    try:
        return os.fsencode(path.name).decode("utf-8")
    except UnicodeDecodeError:
        raise BagFormatError(f"the name {path.name!r} is not UTF-8, as a bag's must be") from None


def local_name(name: str) -> str:
    """Return a name from the metadata as this process can open it under every locale."""
    try:
        return os.fsdecode(name.encode("utf-8"))
    except UnicodeEncodeError:
        raise BagFormatError(f"the name {name!r:.200} is not UTF-8, as a bag's must be") from None


def _load(text: str) -> Any:
    try:
        depth = 0
        for event in yaml.parse(text, Loader=_LOADER):
            if isinstance(event, yaml.AliasEvent):
                raise BagFormatError("the rosbag2 metadata has aliases, which rosbag2 never writes")
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST:  # libyaml looks through all levels at each word
                raise BagFormatError(
                    f"the rosbag2 metadata is nested deeper than {_DEEPEST} levels"
                )
        if number := _LONG_NUMBER.search(text):
            raise BagFormatError(f"the rosbag2 metadata has a number {number[0][:20]}...")
        return yaml.load(text, Loader=_LOADER)
    except (yaml.YAMLError, *MALFORMED) as error:  # the latter of `!!timestamp 1`, for example
        raise BagFormatError(f"the rosbag2 metadata is not YAML: {error_text(error)}") from error


def losses_to_record(losses: Mapping[str, Losses]) -> dict[str, str]:
    """Return the content of the metadata record, with one key for each topic."""
    return {topic: json_text(asdict(item)) for topic, item in losses.items()}


def losses_from_record(record: Mapping[str, str]) -> dict[str, Losses]:
    with parsing(f"the record {LOSSES_RECORD}"):
        return {topic: _losses(json.loads(text)) for topic, text in record.items()}


def _losses(value: Mapping[str, Any]) -> Losses:
    transport, queue, damaged = value["transport"], value["queue"] or 0, value.get("damaged") or 0
    found = Losses(transport if transport is None else int(transport), int(queue), int(damaged))
    for count in (found.transport or 0, found.queue, found.damaged):
        if not 0 <= count < 2**63:
            raise ValueError(f"{count:g} is not a number of messages")
    return found
