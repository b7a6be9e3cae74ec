"""Types of the messages of a proof: those that are installed here, or an earlier version of them.

Later versions add fields to messages and take none away. So the computed message has every field of
the recorded one, and the fields that the recorded one lacks are not proved.
"""

from __future__ import annotations

from functools import cache

from rosbags.interfaces import Nodetype

from rpud_sim.bag import BagFormatError, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.inspection.verify.recorded_journal import UnverifiableError
from rpud_sim.simulation.topics import TOPICS

JOURNAL = TOPICS["journal"].type


def is_provable(summary: TopicSummary) -> bool:
    """Whether a topic's type is the one that is installed here, or an earlier version of it."""
    try:
        proof_codec(summary)
    except UnverifiableError:
        return False
    return True


def proof_codec(summary: TopicSummary) -> Codec:
    """Return the codec of a topic whose type is the installed one or an earlier version of it."""
    topic = summary.topic
    expected = _expected_type(topic.name, topic.type)
    if topic.type != expected:
        raise UnverifiableError(f"the type of {topic.name} is {topic.type:.80}, not {expected}")
    if topic.type_hash in ("", find_type_hash(expected)):
        return installed_codec(expected)
    installed = installed_codec(expected)
    try:
        codec = Codec(expected, summary.definition or "")
    except BagFormatError:
        codec = None
    if codec is None or not _fields(codec, expected) <= _fields(installed, expected):
        raise UnverifiableError(f"{topic.name} is of another version of {expected}")
    return codec


def fields_not_held(codec: Codec) -> list[str]:
    """Return the fields of the installed type that a codec's type lacks, such as ``squeezed``."""
    name = codec.type_name
    lacking = _fields(installed_codec(name), name) - _fields(codec, name)
    return sorted(path for path, _ in lacking)


def _fields(codec: Codec, type_name: str, path: str = "") -> frozenset[tuple[str, str]]:
    found: set[tuple[str, str]] = set()
    for name, _, (node, described) in codec.fields(type_name):
        inner = f"{path}.{name}" if path else name
        kind = f"{node.name}"
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (node, described), length = described
            kind += f" of {length} {node.name}"
        if node == Nodetype.NAME:
            found |= _fields(codec, described, inner)
        else:
            kind += f" {described}"
        found.add((inner, kind))
    return frozenset(found)


def _expected_type(name: str, type_name: str) -> str:
    own = TOPICS.get(name.rpartition("/")[2])
    return JOURNAL if type_name == JOURNAL or own is None else own.type


@cache
def installed_codec(type_name: str) -> Codec:
    """Return the codec of a type as it is installed here; making one takes long."""
    return Codec(type_name, find_definition(type_name))
