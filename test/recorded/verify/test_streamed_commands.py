"""Bags of a drill that gets another command in each block, as from a controller of an arm."""

from collections import deque
from itertools import pairwise

import pytest
from altered_bags import altered, edited, flipped, messages_of, numbered
from rpud_sim.recorded.recorded_journal import installed_codec
from rpud_sim.recorded.verify.verification import verify
from support import called

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.definitions import find_definition
from rpud_sim.recorded.offline_bag import write_fork
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.topics import TOPICS

SECOND = 1_000_000_000
HELD = ("journal", "status", "faults", "wrench", "contact_force", "waveform")
JOURNAL = installed_codec(TOPICS["journal"].type)


def streamed_bag(path, rate, duration, start, silent=()):
    """Record a drill whose weight on bit is a ramp, from a start on [s]: latched entries first.

    Silent topics have no message.
    """
    heard = []
    run = Run(
        Beginning(Settings(telemetry_rate=rate)), Journal(), lambda topic: heard and topic in HELD
    )
    run.begin(0)
    latched = deque(maxlen=TOPICS["journal"].depth)
    codecs = {name: installed_codec(TOPICS[name].type) for name in HELD}
    with BagWriter(path) as bag:
        for name in HELD:
            topic = TOPICS[name]
            bag.add_topic(Topic(f"/rpud/{name}", topic.type), find_definition(topic.type))
        for name in silent:
            bag.add_topic(Topic(f"/rpud/{name}", "rpud_msgs/msg/WeightOnBit"))

        def write(messages, log_time=None):
            for time, name, values in messages:
                if name in HELD:
                    data = codecs[name].encode(values)
                    bag.write_message(f"/rpud/{name}", data, log_time or time, time)

        faults = []
        run.simulation.inject(Fault("lost_preload", magnitude=0.1))
        for number in range(round(duration * rate)):
            if not heard and number >= round(start * rate):
                heard.append(True)
                write(latched, run.time)
                write(faults[-1:], run.time)
            messages = list(run.advance_to(run.next_boundary))
            if heard:
                write(messages)
                if run.time % SECOND == 0:
                    write([run.status("running", Bookkeeping(commands_accepted=number))])
            else:
                latched.extend(each for each in messages if each[1] == "journal")
                faults.extend(each for each in messages if each[1] == "faults")
            run.control.apply(WeightOnBit(10.0 + number / 1000.0))
    return path


@pytest.fixture(scope="module")
def late(tmp_path_factory):
    return streamed_bag(tmp_path_factory.mktemp("late") / "bag", 400, 4.2, 3.0)


def test_verify_says_from_where_it_proves(late, capsys):
    verification = verify(late)
    assert verification.proved
    assert 0.5 * SECOND < verification.begins <= 1.15 * SECOND
    assert verification.topics["/rpud/wrench"].equal == 480
    assert verification.total.before == verification.topics["/rpud/faults"].before == 1
    code, output, _ = called(capsys, "verify", late)
    assert code == 0
    assert f"proved from {verification.begins / SECOND:.9f} s on" in output


@pytest.mark.extended
@pytest.mark.parametrize(("rate", "start"), [(100, 60.0), (1000, 10.0)])
def test_a_recorder_that_starts_late_in_a_stream_has_what_proves_its_bag(tmp_path, rate, start):
    verification = verify(streamed_bag(tmp_path / "bag", rate, start + 0.5, start))
    assert verification.proved
    assert verification.topics["/rpud/wrench"].equal == rate / 2
    latched = TOPICS["journal"].depth / rate  # time that its entries reach back [s]
    assert verification.begins > (start - latched) * SECOND


def test_commands_that_the_drill_took_and_the_bag_lacks_are_a_warning(tmp_path, late):
    topics = ("command/weight_on_bit", "command/drive", "command/feed")
    verification = verify(streamed_bag(tmp_path / "bag", 100, 3.1, 0.0, topics))
    assert verification.proved
    lacking = "the drill took 200 commands from the first to the last status, and the bag holds 0"
    assert lacking in verification.warnings
    assert not any("commands" in text for text in verify(late).warnings)  # none were to be recorded


def test_faults_that_began_before_the_journal_are_compared_with_the_state(late, tmp_path):
    place = len(messages_of(late, {"/rpud/faults"})[0].data) - 1
    change = numbered("faults", 0, lambda m: [flipped(m.data, place)])
    verification = verify(altered(late, tmp_path / "bag", change))
    assert verification.first_difference.topic == "/rpud/faults"


def test_only_the_first_messages_are_of_before_the_journal(late, tmp_path):
    change = numbered("wrench", 5, lambda m: [m.data[:4] + bytes(4) + m.data[8:]])
    verification = verify(altered(late, tmp_path / "bag", change))
    assert verification.first_difference.field == "header.stamp.sec"
    assert verification.topics["/rpud/wrench"].before == 0


def test_the_last_thousand_entries_hold_a_state_at_any_time(late):
    kinds = [JOURNAL.decode(m.data).kind for m in messages_of(late, {"/rpud/journal"})]
    places = [place for place, kind in enumerate(kinds) if kind == "state"]
    assert all(later - earlier <= 260 for earlier, later in pairwise(places))
    assert places[0] <= 260


def test_a_run_goes_on_from_a_state_in_a_bag(late, tmp_path):
    forked = write_fork(late, tmp_path / "fork", 3.6)
    assert forked.messages > 0
    assert verify(tmp_path / "fork").proved


def test_messages_of_before_the_journal_begins_are_not_decided(late, tmp_path):
    places = [
        place
        for place, m in enumerate(messages_of(late, {"/rpud/journal"}))
        if JOURNAL.decode(m.data).kind == "state"
    ]
    numbers = iter(range(1_000_000))

    def without_older_entries(message):
        lost = message.topic == "/rpud/journal" and next(numbers) < places[-1]
        return [] if lost else [message.data]

    verification = verify(altered(late, tmp_path / "bag", without_older_entries))
    assert verification.total.before > 0
    assert verification.undecided.endswith("messages are of before the journal begins")
    assert verification.first_difference is None


def without_last_entries(bag, out, count, change=lambda message: [message.data]):
    entries = len(messages_of(bag, {"/rpud/journal"}))
    numbers = iter(range(1_000_000))

    def cut(message):
        lost = message.topic == "/rpud/journal" and next(numbers) >= entries - count
        return [] if lost else change(message)

    return altered(bag, out, cut)


@pytest.mark.parametrize("count", [2, 120])  # a status counts them, or not
def test_a_journal_that_ends_early_is_no_difference(late, tmp_path, capsys, count):
    verification = verify(without_last_entries(late, tmp_path / "bag", count))
    assert verification.first_difference is None
    assert verification.undecided.startswith("the journal ends early")
    code, output, _ = called(capsys, "verify", tmp_path / "bag")
    assert code == 1
    assert "not decided: the journal ends early" in output


def test_a_flipped_bit_before_an_early_end_is_a_difference(late, tmp_path):
    change = numbered("wrench", 5, lambda m: [flipped(m.data, 60)])
    verification = verify(without_last_entries(late, tmp_path / "bag", 120, change))
    assert verification.first_difference.topic == "/rpud/wrench"


def test_an_altered_state_is_a_difference_unless_it_is_the_first(late, tmp_path):
    def edit(fields, content):
        if fields["kind"] == "state" and content["time"] > 3 * SECOND:
            content["state"]["run"]["of"]["simulation"]["of"]["_drawn"] = 1.0

    verification = verify(altered(late, tmp_path / "bag", edited(edit)))
    assert verification.first_difference.field == "state"


@pytest.mark.parametrize(
    "spoil",
    [
        lambda state: state.clear(),
        lambda state: state.update(run={"object": "os.system", "of": {}}),
        lambda state: plant(state).update(
            _conditions={"value": "rpud_sim.cli.main.main", "of": []}
        ),
        lambda state: plant(state).update(next_step=0),
        lambda state: engine(state).update(_state={"array": "float64", "bytes": "AAAAAAAAAAA="}),
        lambda state: engine(state)["_drill"]["of"].__setitem__(0, "text"),
        lambda state: state["run"]["of"].update(_rate=10**18),
    ],
)
def test_a_state_that_no_drill_has_is_one_line(late, tmp_path, capsys, spoil):
    def edit(fields, content):
        if fields["kind"] == "state":
            spoil(content["state"])

    code, _, error = called(capsys, "verify", altered(late, tmp_path / "bag", edited(edit)))
    assert code == 1
    assert error.startswith("rpud verify: ")
    assert "cannot be done" in error
    assert error.count("\n") == 1


def plant(state):
    return state["run"]["of"]["simulation"]["of"]["_plant"]["of"]


def engine(state):
    return plant(state)["engine"]["of"]
