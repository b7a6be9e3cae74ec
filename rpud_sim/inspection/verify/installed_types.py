"""Types of the messages of a proof, as they are installed here."""

from __future__ import annotations

from functools import cache

from rpud_sim.bag import BagFormatError, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.inspection.verify.recorded_journal import UnverifiableError
from rpud_sim.simulation.topics import TOPICS

JOURNAL = TOPICS["journal"].type


def is_provable(summary: TopicSummary) -> bool:
    """Whether a topic's type is the one that is installed here."""
    try:
        proof_codec(summary)
    except UnverifiableError:
        return False
    return True


def proof_codec(summary: TopicSummary) -> Codec:
    """Return the codec of a topic whose type is the installed one."""
    topic = summary.topic
    expected = _expected_type(topic.name, topic.type)
    if topic.type != expected:
        raise UnverifiableError(f"the type of {topic.name} is {topic.type:.80}, not {expected}")
    if topic.type_hash not in ("", find_type_hash(expected)):
        raise UnverifiableError(f"{topic.name} is of another version of {expected}")
    return installed_codec(expected)


def journal_codec(summary: TopicSummary) -> Codec:
    """Return the codec of a journal of any version, for every bag's journal is read."""
    if summary.topic.type_hash in ("", find_type_hash(JOURNAL)):
        return installed_codec(JOURNAL)
    try:
        return Codec(JOURNAL, summary.definition or "")
    except BagFormatError as error:
        raise UnverifiableError(f"{summary.topic.name}: {error}") from None


def _expected_type(name: str, type_name: str) -> str:
    own = TOPICS.get(name.rpartition("/")[2])
    return JOURNAL if type_name == JOURNAL or own is None else own.type


@cache
def installed_codec(type_name: str) -> Codec:
    """Return the codec of a type as it is installed here; making one takes long."""
    return Codec(type_name, find_definition(type_name))
