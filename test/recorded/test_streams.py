"""Two streams compared by the block are as compared message by message, damaged ones too."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_bags import batch_of
from support import examples

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Message, QosProfile, Topic
from rpud_sim.messages.definitions import installed_codec
from rpud_sim.recorded import streams
from rpud_sim.recorded.streams import (
    Matched,
    StreamHead,
    TopicStreams,
    difference,
    matched,
)
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.topics import TOPICS

SECOND = 1_000_000_000
NAMES = ("contact_force", "drill_tool", "trajectory")
CODECS = {name: installed_codec(TOPICS[name].type) for name in NAMES}


def computed():
    """Blocks of what a run gives, by topic."""
    settings = to_settings({"regime": "drilling", "telemetry_rate": 20})
    found = {name: [] for name in NAMES}
    for batch in Run(Plan(Beginning(settings))).advance_to(SECOND // 2):
        if batch.topic in NAMES:
            block = batch.serialized(CODECS[batch.topic])
            found[batch.topic].append(replace(block, topic=f"/rpud/{batch.topic}"))
    return found


COMPUTED = computed()


def blocks_in(messages, sizes):
    while messages:
        count = max(1, sizes.pop() if sizes else 100)
        times = [(m.log_time, m.publish_time) for m in messages[:count]]
        data = [m.data for m in messages[:count]]
        yield batch_of(data, messages[0].topic, times=times)
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


def keyed(blocks, run=0, origin=0):
    """Yield messages with their run, and nothing now and then, as where others are read first."""
    for block in blocks:
        yield [replace(block, run=run, origin=origin)]
        yield []


def steps(name, first, second, **options):
    """Give what matching says, with equal messages counted one by one."""
    found = []
    cursors = [StreamHead(keyed(blocks), CODECS[name]) for blocks in (first, second)]
    for step in matched(*cursors, **options):
        if step == Matched():
            continue
        if step.equal:
            found += ["equal"] * step.equal
        elif step.first and step.second and difference(step.first, step.second) is None:
            found.append("equal")
        else:
            found.append(tuple(each and (each.key, each.data) for each in step[1:]))
    return found


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=examples(40))
@given(damages=DAMAGES, sizes=st.lists(st.integers(1, 50), max_size=8))
def test_by_the_block_the_result_is_that_of_single_messages(name, damages, sizes):
    whole = [
        Message(f"/rpud/{name}", int(block.log_times[n]), int(block.publish_times[n]), data)
        for block in COMPUTED[name]
        for n, data in enumerate(block.message(n) for n in range(len(block)))
    ]
    recorded = damaged(whole, damages)
    found = steps(name, COMPUTED[name], blocks_in(recorded, list(sizes)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(streams, "_equal_count", lambda *_: 0)
        expected = steps(name, COMPUTED[name], blocks_in(recorded, list(sizes)))
    assert found == expected
    if not damages:
        assert found == ["equal"] * len(whole)


def test_a_message_of_another_run_is_no_altered_one():
    """The last one of a run, and the next run without its first message: two that are alone."""
    block = COMPUTED["drill_tool"][0]
    part = block.part(slice(0, 4))
    first = StreamHead(keyed([part], run=2), CODECS["drill_tool"])
    before = keyed([part.part(slice(3, 4))], run=1)
    rest = keyed([part.part(slice(1, None))], run=2)
    second = StreamHead((each for found in (before, rest) for each in found), CODECS["drill_tool"])
    found = [step for step in matched(first, second) if step != Matched()]
    assert [(step.first is None, step.second is None) for step in found[:2]] == [
        (True, False),
        (False, True),
    ]
    assert [step.equal for step in found[2:]] == [3]


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
@settings(max_examples=examples(20))
@given(order=st.lists(st.sampled_from(["/a", "/b", "/c"]), max_size=30))
def test_each_topic_is_read_in_order_however_far_the_others_are(skewed, most, order):
    with rpud_sim.bag.open(skewed) as bag, pytest.MonkeyPatch.context() as patch:
        patch.setattr(streams, "_MOST_WAITING", most)
        found = {"/a": [], "/b": [], "/c": []}
        recorded = TopicStreams(bag.batches)
        blocks = {topic: recorded.stream(topic) for topic in found}
        for topic in order + [name for name in found for _ in range(1500)]:
            for block in next(blocks[topic], ()):
                found[topic] += [block.message(number) for number in range(len(block))]
        for topic in found:
            assert found[topic] == [message.data for message in bag.messages({topic})]
