"""Messages that a bag lacks: at its end, in between, and those that it need not hold."""

import pytest
from altered_bags import altered, messages_of
from inspection.verify.proof_bags import JOURNAL, ON_ARM
from rpud_sim.recorded.verify.verification import PROVED, verify
from sample_bags import write_offline_bag

from rpud_sim.simulation import preset


@pytest.fixture(scope="module")
def longer_bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("longer") / "bag"
    write_offline_bag(path, preset("drilling"), 4.0, 0.2, None, 11)
    return path


def without(*topics, after, before=10**12):
    """Return a change that takes the messages of topics between two times of the bag [s]."""
    names = {f"/rpud/{topic}" for topic in topics}

    def change(message):
        inside = after <= message.log_time / 1e9 <= before
        return [] if message.topic in names and inside else [message.data]

    return change


@pytest.mark.parametrize(
    "kept", [PROVED, ("contact_force",), ("contact_force", "nodal_plane")], ids=len
)
def test_impacts_that_are_missing_at_the_end_are_counted(longer_bag, tmp_path, kept):
    impacts = messages_of(longer_bag, {"/rpud/contact_force"})
    topics = {JOURNAL, "/rpud/status", *(f"/rpud/{name}" for name in kept)}
    change = without("contact_force", after=2.0)
    verification = verify(altered(longer_bag, tmp_path / "bag", change, topics))
    assert not verification.proved
    assert (verification.first_difference, verification.undecided) == (None, "")
    counts = verification.topics["/rpud/contact_force"]
    assert (counts.tail, counts.missing) == (sum(m.log_time > 2e9 for m in impacts), 0)
    assert verification.total.tail == counts.tail


def test_other_topics_show_that_messages_are_missing_at_the_end(longer_bag, tmp_path):
    """As a recorder leaves it that is closed while the drill goes on."""
    impacts = messages_of(longer_bag, {"/rpud/contact_force"})
    ends = {JOURNAL: 0, "/rpud/contact_force": 1e9, "/rpud/nodal_plane": 4e9}

    def change(message):
        return [message.data] if message.log_time <= ends[message.topic] else []

    verification = verify(altered(longer_bag, tmp_path / "bag", change, {*ends}))
    assert not verification.proved
    # The last second shows nothing: a closed recorder leaves messages behind.
    expected = sum(1e9 < m.log_time < 2.97e9 for m in impacts)
    assert expected <= verification.total.tail <= expected + 10


def test_a_topic_without_a_message_is_missing_too(longer_bag, tmp_path):
    change = without("contact_force", after=0.0)
    verification = verify(altered(longer_bag, tmp_path / "bag", change))
    assert not verification.proved
    assert verification.topics["/rpud/contact_force"].tail > 900


def test_messages_under_way_when_a_recorder_is_closed_are_not_missing(longer_bag, tmp_path):
    """Each topic ends a little before the other, and the drill goes on."""
    names = [name for name in (*PROVED, "status") if name not in ON_ARM]
    ends = {f"/rpud/{name}": 3.5 - 0.03 * i for i, name in enumerate(names)}

    def change(message):
        return [message.data] if message.log_time / 1e9 < ends.get(message.topic, 0.1) else []

    verification = verify(altered(longer_bag, tmp_path / "bag", change))
    assert verification.proved


def test_a_topic_that_falls_silent_and_returns_is_missing_in_between(longer_bag, tmp_path):
    change = without("contact_force", after=1.0, before=3.0)
    verification = verify(altered(longer_bag, tmp_path / "bag", change))
    assert verification.proved
    assert verification.topics["/rpud/contact_force"].missing > 700
