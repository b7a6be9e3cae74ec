"""Message types that are installed here, which the topics of a proof must have."""

from __future__ import annotations

from functools import cache

from rpud_sim.bag import Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.inspection.verify.recorded_journal import UnverifiableError
from rpud_sim.simulation.topics import TOPICS

JOURNAL = TOPICS["journal"].type


def is_installed(topic: Topic) -> bool:
    """Whether a topic's type is the one that is installed here."""
    expected = _expected_type(topic)
    return topic.type == expected and topic.type_hash in ("", find_type_hash(expected))


def installed_codec(topic: Topic) -> Codec:
    """Return the codec of a topic.

    Raises:
        UnverifiableError: if its type is not the one that is installed here.
    """
    expected = _expected_type(topic)
    if topic.type != expected:
        raise UnverifiableError(f"the type of {topic.name} is {topic.type:.80}, not {expected}")
    if not is_installed(topic):
        raise UnverifiableError(f"{topic.name} is of another version of {expected}")
    return _codec(expected)


def _expected_type(topic: Topic) -> str:
    own = TOPICS.get(topic.name.rpartition("/")[2])
    return JOURNAL if topic.type == JOURNAL or own is None else own.type


@cache
def _codec(type_name: str) -> Codec:
    return Codec(type_name, find_definition(type_name))
