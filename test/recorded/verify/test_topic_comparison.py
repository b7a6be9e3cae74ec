"""Blocks of messages are compared with the result of single ones, on damaged recordings too."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from inspection.verify.test_recorded_journal import recorded
from rpud_sim.recorded.recorded_journal import installed_codec
from rpud_sim.recorded.recorded_topics import RecordedMessages, RecordedTopics
from rpud_sim.recorded.verify.coverage import Coverage, JournalStretches
from rpud_sim.recorded.verify.messages import computed_blocks
from rpud_sim.recorded.verify.topic_comparison import TopicComparison
from support import examples

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Message, QosProfile, Topic
from rpud_sim.bag.batches import blocks_of
from rpud_sim.recorded import recorded_topics
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.telemetry import Together
from rpud_sim.simulation.topics import TOPICS

SECOND = 1_000_000_000
NAMES = ("contact_force", "drill_tool", "trajectory")
CODECS = {name: installed_codec(TOPICS[name].type) for name in NAMES}


def computed(stretches):
    """What several stretches give, the later ones with the stamps of the first."""
    found = []
    for stretch in range(stretches):
        run = Run(Beginning(to_settings({"regime": "drilling", "telemetry_rate": 20})))
        run.begin(0)
        for time in (SECOND // 5, SECOND // 2):
            found += [(each, stretch) for each in run.advance_together(time)]
    return [each for each in found if isinstance(each[0], Together)]


COMPUTED = {number: computed(number) for number in (1, 2)}


def blocks_in(messages, sizes):
    while messages:
        count = max(1, sizes.pop() if sizes else 100)
        yield from blocks_of(messages[:count])
        messages = messages[count:]


DAMAGES = st.lists(
    st.tuples(
        st.sampled_from(
            ["lose", "repeat", "alter", "cut", "swap", "insert", "late", "stamp", "padding"]
        ),
        st.integers(0, 400),
        st.integers(0, 60),
    ),
    max_size=5,
)


def damaged(messages, damages):
    messages = list(messages)
    for kind, place, other in damages:
        if not messages:
            break
        place %= len(messages)
        message = messages[place]
        if kind == "lose":
            del messages[place : place + 1 + other % 5]
        elif kind == "repeat":
            messages.insert(place, message)
        elif kind in ("alter", "stamp"):
            data = bytearray(message.data)
            place_in_it = 5 if kind == "stamp" else other
            data[place_in_it % len(data)] ^= 1 + other
            messages[place] = message._replace(data=bytes(data))
        elif kind == "cut":
            data = message.data[: 1 + other % len(message.data)]
            messages[place] = message._replace(data=data)
        elif kind == "swap":
            other %= len(messages)
            messages[place], messages[other] = messages[other], message
        elif kind == "insert":
            messages.insert(other % len(messages), message)
        elif kind == "late":
            time = message.publish_time + other * SECOND // 20
            messages[place] = message._replace(publish_time=time)
        elif kind == "padding":
            data = message.data[:3] + b"\1" + message.data[4:]
            messages[place] = message._replace(data=data)
    return messages


def stretches_of(count):
    """A journal whose stretches begin a second apart."""
    entries = []
    for number in range(count):
        # Otherwise two beginnings without an entry between them would be one.
        entries += [recorded(number, kind, number * SECOND) for kind in ("begin", "stop")]
    return JournalStretches(iter(entries))


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=examples(40))
@given(
    runs=st.sampled_from([1, 2]),
    damages=DAMAGES,
    sizes=st.lists(st.integers(1, 50), max_size=8),
    reached=st.sampled_from([0, SECOND // 4, SECOND]),
)
def test_by_the_block_the_result_is_that_of_single_messages(name, runs, damages, sizes, reached):
    found = COMPUTED[runs]
    recorded = []
    for together, stretch in found:
        for time, topic, fields in together.messages():
            if topic == name:
                data = CODECS[name].encode(fields)
                # The stretches of a bag follow each other.
                published = time + stretch * SECOND + 1
                recorded.append(Message(f"/rpud/{name}", published, published, data))
    recorded = damaged(recorded, damages)
    results = []
    for by_block in (False, True):
        source = RecordedMessages(blocks_in(recorded, list(sizes)))
        if not by_block:
            source.pass_equal = lambda *_: 0
        comparison = TopicComparison(
            CODECS[name],
            source,
            stretches_of(runs),
            Coverage((0, 0), (runs - 1, reached), 0, None, 0),
        )
        for together, stretch in found:
            end = together.end
            for block in computed_blocks(together, {name: CODECS[name]}, stretch, end):
                comparison.add(block)
        comparison.finish()
        assert comparison.exhausted
        results.append((comparison.counts, repr(comparison.suspects)))
    assert results[1] == results[0]


# --- reading ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def skewed(tmp_path_factory):
    """A bag in which one topic ends early, another begins late, and a third is there throughout."""
    path = tmp_path_factory.mktemp("bags") / "skewed"
    with BagWriter(path, chunk_size=500) as bag:
        for name in "abc":
            bag.add_topic(Topic(f"/{name}", "std_msgs/msg/String", "", (QosProfile(),)))
        for number in range(300):
            names = "ac" if number < 50 else "bc" if number > 250 else "c"
            for name in names:
                bag.write(f"/{name}", f"{name} {number}".encode(), number, number)
    return path


@pytest.mark.parametrize("most", [0, 100, 1 << 20])
@settings(max_examples=20)
@given(order=st.lists(st.sampled_from(["/a", "/b", "/c"]), max_size=30))
def test_each_topic_is_read_in_order_however_far_the_others_are(skewed, most, order):
    with rpud_sim.bag.open(skewed) as bag, pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorded_topics, "_MOST_WAITING", most)
        found = {"/a": [], "/b": [], "/c": []}
        recorded = RecordedTopics(bag)
        blocks = {topic: recorded.blocks(topic) for topic in found}
        for topic in order + [name for name in found for _ in range(301)]:
            block = next(blocks[topic], None)
            if block is not None:
                found[topic] += [block.message(number) for number in range(len(block))]
        for topic in found:
            assert found[topic] == [message.data for message in bag.messages({topic})]
