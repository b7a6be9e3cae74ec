"""A recorded run goes on from any instant: the same way bit for bit, or another way."""

import hashlib
import itertools
import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from altered_bags import altered
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_bags import write_offline_bag

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.manifest import RECORD_NAME, manifest_from_record
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.inspection.forked_bag import write_fork
from rpud_sim.inspection.recorded_run import ForkError
from rpud_sim.inspection.verify.installed_types import installed_codec
from rpud_sim.inspection.verify.verification import verify
from rpud_sim.simulation import preset
from rpud_sim.simulation.changes import (
    Changes,
    parameter_changes,
    parse_injections,
    read_commands,
)
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.scenario import parse_scenario
from rpud_sim.simulation.topics import TOPICS

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
START = 1_700_000_000 * SECOND + 123
JOURNAL = "/rpud/journal"
STATUS = "/rpud/status"
SCENARIO = parse_scenario(
    {
        "seed": 4,
        "faults": [
            {"kind": "lost_preload", "onset": 0.0312345, "duration": 0.05},
            {"kind": "delayed", "channel": "contact_force", "onset": 0.02, "magnitude": 0.013},
            {"kind": "noise", "channel": "wrench", "onset": {"uniform": [0.0, 0.1]}},
            {"kind": "garbage", "channel": "drill_tool", "onset": 0.06, "duration": 0.03},
        ],
    },
    "scenario",
)
VALUES = {
    "prescribed": {"regime": "drilling"},
    "resonance": {
        "actuator_model": "resonance",
        "generator": "tracking",
        "rock_model": "specific_energy",
        "telemetry_rate": 130,
        "block_duration": 0.03,
    },
}


class Used:
    """Bag of a drill to which everything happened, and all that it published."""

    def __init__(self, path, values):
        random = np.random.default_rng(1)
        self.path = path
        self.published = write_used(path, values, lambda number: random.random() < 0.1)


def digest(data):
    """Return a short text for a message, which a failing test can show."""
    return hashlib.sha256(data).hexdigest()[:16]


def use(values):
    """Yield the messages of a drill to which everything happens: number of the run, and each."""
    journal = Journal()
    watched = {"command_timeout": 0.04, "command_loss_ramp": 0.02}
    run = Run(Beginning(to_settings({**values, **watched}), 0.3, 5, SCENARIO), journal)

    def advance(milliseconds):
        end = run.time + round(milliseconds * MILLISECOND)
        while run.time < end:
            yield from run.advance_to(min(run.next_boundary, end))
            run.control.act()

    def first():
        run.begin(START)
        yield from advance(33.3)
        run.control.apply(WeightOnBit(25.0))
        yield from advance(20)
        run.simulation.inject(Fault("bias", "nodal_plane", 1e-5), 30 * MILLISECOND)
        yield from run.changes()
        run.simulation.inject(Fault("stuck", "reacting_force"))
        run.control.apply(Drive(True, 80.0, 16_050.0))
        yield from advance(7.7777)
        run.simulation.clear(next(iter(run.simulation.faults.active)).number)
        run.control.activate(False)
        yield from advance(9)
        run.control.activate(True)
        yield from advance(70)  # the commands are lost, and go down to nothing
        run.configure(to_settings({**values, "actuator_restitution": 0.8, "regime": "free"}))
        yield from run.flush()
        run.place(START + 7)  # a reset of the time alone
        yield from advance(31.4)
        yield from run.flush()

    def second():
        run.begin(START + SECOND)
        yield from advance(41)
        run.control.apply(WeightOnBit(5.0))
        yield from advance(30)
        yield from run.flush("end")

    yield from ((1, message) for message in first())
    run = Run(Beginning(to_settings({**values, **watched}), 0.7, 6), journal)
    yield from ((2, message) for message in second())


def write_used(path, values, lost=lambda number: False):
    """Write such a drill's bag, without those messages that got lost; return all messages."""
    codecs = {name: installed_codec(topic.type) for name, topic in TOPICS.items()}
    published = []
    numbers = itertools.count()
    with BagWriter(path) as bag:
        for name, topic in TOPICS.items():
            bag.add_topic(
                Topic(f"/rpud/{name}", topic.type, find_type_hash(topic.type)),
                find_definition(topic.type),
            )
        for run, (time, name, fields) in use(values):
            data = codecs[name].encode(fields)
            published.append((run, time, f"/rpud/{name}", digest(data)))
            if name == "journal" or not lost(next(numbers)):
                log_time = START + run * SECOND + time
                bag.write(f"/rpud/{name}", data, log_time + 5000, log_time)
    return published


@pytest.fixture(scope="module", params=VALUES)
def used(request, tmp_path_factory):
    return Used(tmp_path_factory.mktemp("used") / "bag", VALUES[request.param])


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    path = tmp_path_factory.mktemp("plain") / "bag"
    write_offline_bag(path, preset("drilling"), 0.3, 0.2, SCENARIO, 11)
    return path


def held(path, topics=None):
    with rpud_sim.bag.open(path) as bag:
        return [(m.log_time, m.topic, digest(m.data)) for m in bag.messages(topics)]


def decoded(path, name):
    """Return the messages of one topic."""
    codec = installed_codec(TOPICS[name].type)
    with rpud_sim.bag.open(path) as bag:
        return [codec.decode(message.data) for message in bag.messages({f"/rpud/{name}"})]


def entries_of(path):
    return decoded(path, "journal")


def manifest_of(path):
    with rpud_sim.bag.open(path) as bag:
        return manifest_from_record(bag.records(RECORD_NAME)[0])


@settings(max_examples=8, deadline=None)
@given(place=st.floats(0.0, 1.0, exclude_max=True), run=st.integers(1, 2))
def test_without_a_change_it_is_the_rest_of_the_run(used, place, run):
    path, published = used.path, used.published
    times = [time for number, time, _, _ in published if number == run]
    time = int(place * max(times))
    with tempfile.TemporaryDirectory() as folder:
        write_fork(path, Path(folder, "fork"), time / SECOND, run=run)
        origin = min(t for t, _, _ in held(Path(folder, "fork")))
        found = [each for each in held(Path(folder, "fork")) if each[0] > origin]
    for topic in (f"/rpud/{name}" for name in TOPICS if name != "status"):
        rest = [data for n, t, name, data in published if (n, name) == (run, topic) and t > time]
        forked = [data for _, name, data in found if name == topic]
        if run == 1 and topic == JOURNAL:  # it ended by a reset, and its fork by itself
            rest, forked = rest[:-1], forked[:-1]
        assert forked == rest, topic


@settings(max_examples=8, deadline=None)
@given(place=st.floats(0.0, 1.0, exclude_max=True))
def test_of_a_bag_without_ros_every_message_and_time_is_the_same(plain, place):
    time = int(place * 300 * MILLISECOND)
    with tempfile.TemporaryDirectory() as folder:
        forked = write_fork(plain, Path(folder, "fork"), time / SECOND)
        found = [each for each in held(Path(folder, "fork")) if each[0] > time]
        proved = verify(Path(folder, "fork")).proved
    assert found == [each for each in held(plain) if each[0] > time]
    assert proved
    assert not forked.changed


@pytest.mark.parametrize("at", [0.0, 0.0567, 0.1])
@pytest.mark.parametrize("run", [1, 2])
def test_it_is_proved_itself_and_can_be_forked(used, tmp_path, at, run):
    path = used.path
    at = min(at, 0.06) if run == 2 else at
    changes = parse_injections(["restitution_loss,magnitude=0.8,onset=0.0031"])
    write_fork(path, tmp_path / "fork", at, 0.1, changes, run=run)
    verification = verify(tmp_path / "fork")
    assert verification.proved, verification
    assert verification.warnings == ()
    time = round(at * SECOND) + 5 * MILLISECOND
    write_fork(tmp_path / "fork", tmp_path / "again", time / SECOND, run=run)
    assert verify(tmp_path / "again").proved
    begin = min(t for t, _, _ in held(tmp_path / "again"))
    rest = [each for each in held(tmp_path / "again") if each[0] > begin]
    assert rest == [each for each in held(tmp_path / "fork") if each[0] > begin]


def test_it_names_where_it_came_from(plain, tmp_path):
    changes = parse_injections(["restitution_loss,duration=0.1"]) + parameter_changes(
        {"weight_on_bit": 30}
    )
    write_fork(plain, tmp_path / "fork", 0.1, 0.05, changes)
    origin = manifest_of(tmp_path / "fork").forked_from
    assert (origin["bag"], origin["run"], origin["at"]) == (str(plain), 1, 0.1)
    assert len(origin["journal"]) == 64
    assert origin["changes"]["parameters"] == {"weight_on_bit": 30}
    (planned,) = origin["changes"]["planned"]
    assert planned["delay"] == 0.0
    assert planned["Injection"]["fault"]["kind"] == "restitution_loss"
    assert manifest_of(plain).forked_from == {}


def test_a_change_acts_exactly_at_the_instant(plain, tmp_path):
    changes = parameter_changes(
        {"weight_on_bit": 40.0, "drive_enabled": False, "regime": "free"}
    ) + parse_injections(["bias,channel=wrench,magnitude=5,duration=0.01"])
    write_fork(plain, tmp_path / "fork", 0.1234567, 0.2, changes)
    entries = entries_of(tmp_path / "fork")
    assert [e.sequence for e in entries] == list(range(len(entries)))
    made = [e for e in entries if json.loads(e.content)["time"] == 123_456_700]
    assert [e.kind for e in made] == ["stop", "configure", "weight_on_bit", "drive", "inject"]
    assert json.loads(made[2].content)["force"] == 40.0
    times = [t for t, topic, _ in held(tmp_path / "fork") if topic != JOURNAL]
    assert (min(times), max(times)) == (123_456_700, 323_456_700)


def test_a_change_changes_what_follows(plain, tmp_path):
    write_fork(plain, tmp_path / "fork", 0.1, 0.2, parameter_changes({"weight_on_bit": 30.0}))
    own = held(tmp_path / "fork", {"/rpud/nodal_plane"})
    source = [each for each in held(plain, {"/rpud/nodal_plane"}) if each[0] > 100 * MILLISECOND]
    assert [t for t, _, _ in own] == [t for t, _, _ in source]
    assert all(one[2] != other[2] for one, other in zip(own, source, strict=True))


def test_it_may_go_on_beyond_the_end_of_the_recorded_run(plain, tmp_path):
    forked = write_fork(plain, tmp_path / "fork", 0.3, 0.2)
    assert forked.duration == pytest.approx(0.2)
    assert verify(tmp_path / "fork").proved
    whole = tmp_path / "whole"
    write_offline_bag(whole, preset("drilling"), 0.5, 0.2, SCENARIO, 11)
    planes = {"/rpud/nodal_plane", "/rpud/contact_force"}
    rest = [each for each in held(whole, planes) if each[0] > 300 * MILLISECOND]
    # A contact that had not ended at the instant is told after it.
    assert [each for each in held(tmp_path / "fork", planes) if each[0] > 300 * MILLISECOND] == rest


def commanded(entries, after):
    """Return times and kinds of the commands after a time [ns]."""
    found = ((json.loads(e.content)["time"], e.kind) for e in entries)
    return [each for each in found if each[0] > after and each[1] in ("weight_on_bit", "drive")]


def test_own_commands_replace_the_recorded_ones(used, tmp_path):
    path = used.path
    (tmp_path / "commands.yaml").write_text(
        "commands:\n"
        "  - {time: 0.0055, weight_on_bit: 12}\n"
        "  - {time: 0.02, drive: {enabled: false}}\n"
        "  - {time: 0.03, drive: {voltage: 70}}\n"
        "faults:\n"
        "  - {kind: hard_rock, onset: 0.01, duration: 0.01}\n"
    )
    changes = read_commands(tmp_path / "commands.yaml")
    forked = write_fork(path, tmp_path / "fork", 0.02, 0.07, changes)
    found = commanded(entries_of(tmp_path / "fork"), 20 * MILLISECOND)
    assert found == [(25_500_000, "weight_on_bit"), (40_000_000, "drive"), (50_000_000, "drive")]
    with_rock = "rock_model" in manifest_of(tmp_path / "fork").parameters
    assert with_rock
    refused = [w for w in forked.warnings if "hard_rock" in w]
    assert all(w.startswith("refused at 0.03 s: ") for w in refused)
    assert verify(tmp_path / "fork").proved


def test_the_watchdog_watches_over_own_commands(used, tmp_path):
    """40 ms after the last command of the file they are lost, and go down within 20 ms."""
    path = used.path
    (tmp_path / "commands.yaml").write_text("commands: [{time: 0.01, weight_on_bit: 12}]")
    changes = read_commands(tmp_path / "commands.yaml")
    write_fork(path, tmp_path / "fork", 0.01, 0.1, changes)
    entries = entries_of(tmp_path / "fork")
    times = [time for time, kind in commanded(entries, 20 * MILLISECOND) if kind == "drive"]
    assert times[0] >= 60 * MILLISECOND
    assert (
        json.loads(next(e for e in reversed(entries) if e.kind == "drive").content)["enabled"]
        is False
    )
    assert verify(tmp_path / "fork").proved


def test_a_value_that_is_set_stays_when_the_recorded_run_changes_others(used, tmp_path):
    path = used.path
    changes = parameter_changes({"actuator_restitution": 0.55})
    write_fork(path, tmp_path / "fork", 0.05, None, changes)
    recorded = [e for e in entries_of(tmp_path / "fork") if e.kind == "configure"]
    values = [json.loads(e.content)["parameters"] for e in recorded]
    assert [v["actuator_restitution"] for v in values] == [0.55, 0.55]
    assert [v["regime"] for v in values] == ["drilling", "free"]


def test_a_recorded_clear_finds_its_fault_under_another_number(used, tmp_path):
    path = used.path
    forked = write_fork(path, tmp_path / "fork", 0.0001, 0.07, parse_injections(["lost_preload"]))
    # The scenario begins the same fault later, which a node would refuse as well.
    assert not any("clear" in warning for warning in forked.warnings)
    last = decoded(tmp_path / "fork", "faults")[-1]
    kinds = {fault.kind for fault in last.faults if not fault.active}
    clears = [e for e in entries_of(tmp_path / "fork") if e.kind == "clear"]
    assert len(clears) == 1
    assert kinds


def test_a_bag_that_ended_before_the_drill_tells_how_far(plain, tmp_path):
    """As after a crash of the recorder: no end in the journal, and the last blocks are missing."""

    def change(message):
        return [message.data] if message.log_time <= 234 * MILLISECOND else []

    torn = altered(plain, tmp_path / "torn", change)
    forked = write_fork(torn, tmp_path / "fork", 0.1)
    assert forked.duration == pytest.approx(0.13)
    assert verify(tmp_path / "fork").proved


def without_entry(source, out, number):
    numbers = itertools.count()

    def change(message):
        lost = message.topic == JOURNAL and next(numbers) == number
        return [] if lost else [message.data]

    return altered(source, out, change)


def test_what_the_bag_cannot_tell_is_refused(used, plain, tmp_path):
    path = used.path
    late = without_entry(path, tmp_path / "late", 0)
    with pytest.raises(ForkError, match="/rpud/journal: entries 0 to 0 of the journal are missing"):
        write_fork(late, tmp_path / "fork", 0.01)
    torn = without_entry(path, tmp_path / "torn", 6)
    known = json.loads(entries_of(path)[5].content)["time"] / SECOND
    with pytest.raises(ForkError, match=r"complete up to .* alone: .* 6 to 6 .* are missing"):
        write_fork(torn, tmp_path / "fork", known + 0.001)
    with pytest.raises(ForkError, match="give a --duration that ends before"):
        write_fork(torn, tmp_path / "fork", known / 2)
    write_fork(torn, tmp_path / "before", known / 2, known / 4)
    none = altered(plain, tmp_path / "none", lambda m: [m.data], {"/rpud/wrench"})
    with pytest.raises(ForkError, match="holds no journal; record the topic journal"):
        write_fork(none, tmp_path / "fork", 0.1)
    with pytest.raises(ForkError, match=r"--at = 0.31 s is outside the run of the bag: \[0, 0.3\]"):
        write_fork(plain, tmp_path / "fork", 0.31)
    with pytest.raises(ForkError, match=r"--at = 9 s is outside run 2 of 2 of the bag"):
        write_fork(path, tmp_path / "fork", 9.0, run=2)
    with pytest.raises(ForkError, match=r"--run = 3 is outside its range \[1, 2\]"):
        write_fork(path, tmp_path / "fork", 0.1, run=3)
    with pytest.raises(ForkError, match=r"nothing is left of the recorded run after --at = 0.3 s"):
        write_fork(plain, tmp_path / "fork", 0.3)
    with pytest.raises(ForkError, match="no journal named /rpud/jurnal, but /rpud/journal"):
        write_fork(plain, tmp_path / "fork", 0.3, topic="/rpud/jurnal")
    mended = Path(__file__).parents[1] / "data" / "0.1.0" / "stepped"
    with pytest.raises(ForkError, match=r"the physics was mended after version 0\.1\.0"):
        write_fork(mended, tmp_path / "fork", 0.01)
    assert not (tmp_path / "fork").exists()


def test_a_bag_of_an_earlier_version_is_forked_with_a_warning(tmp_path):
    source = Path(__file__).parents[1] / "data" / "0.1.0" / "offline_free"
    forked = write_fork(source, tmp_path / "fork", 0.05)
    assert any(w.startswith("made by sources ") and "forked by" in w for w in forked.warnings)
    force = {"/rpud/reacting_force"}
    rest = [each for each in held(source, force) if each[0] > 50 * MILLISECOND]
    assert [e for e in held(tmp_path / "fork", force) if e[0] > 50 * MILLISECOND] == rest


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: parameter_changes({"free_mas": 1}), "did you mean free_mass"),
        (lambda: parameter_changes({"free_mass": 1}), "free_mass cannot change during a run"),
        (lambda: parse_injections(["nois,channel=wrench"]), "did you mean noise"),
        (lambda: parse_injections(["noise,chanel=wrench"]), "did you mean channel"),
        (lambda: parse_injections(["noise,channel=wrench,magnitude=x"]), "is not a number"),
    ],
)
def test_a_change_that_cannot_be_is_named(make, reason):
    with pytest.raises(ParameterError, match=reason):
        make()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[]", "is not a scenario"),
        ("commands: 3", "commands = 3 is not a list"),
        ("commands: [{time: 1}]", "command 1: it needs a time, and weight_on_bit, drive or feed"),
        ("commands: [{time: -1, weight_on_bit: 2}]", "command 1: time = -1 s is outside"),
        ("commands: [{time: 1, weight_on_bit: -2}]", "weight_on_bit = -2 N is outside"),
        ("commands: [{time: 1, weigth: 2}]", "'weigth' is not one of"),
        ("commands: [{time: 1, drive: {enabled: maybe}}]", "'maybe' is not true or false"),
        ("commands: [{time: 1, drive: {frequency: .nan}}]", "drive frequency = nan"),
        ("comands: []", "'comands' is not one of seed, faults"),
    ],
)
def test_a_command_file_that_cannot_be_is_named(tmp_path, text, reason):
    (tmp_path / "commands.yaml").write_text(text)
    with pytest.raises(ParameterError, match=reason) as raised:
        read_commands(tmp_path / "commands.yaml")
    assert str(tmp_path / "commands.yaml") in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_change_at_the_instant_that_is_refused_leaves_no_bag(plain, tmp_path):
    with pytest.raises(ParameterError, match="resonance_drift cannot be honoured"):
        write_fork(plain, tmp_path / "fork", 0.1, None, parse_injections(["resonance_drift"]))
    with pytest.raises(ParameterError, match="weight_on_bit = -1 N is outside"):
        write_fork(plain, tmp_path / "fork", 0.1, None, parameter_changes({"weight_on_bit": -1}))
    assert not (tmp_path / "fork").exists()


def test_a_later_one_is_refused_as_a_node_would(plain, tmp_path):
    (tmp_path / "f.yaml").write_text("faults: [{kind: noise, channel: wrench, onset: 0.1}]")
    forked = write_fork(plain, tmp_path / "fork", 0.15, None, read_commands(tmp_path / "f.yaml"))
    assert forked.warnings == (
        "refused at 0.25 s: noise on wrench is already there as fault "
        + forked.warnings[0].rpartition(" ")[2],
    )
    assert verify(tmp_path / "fork").proved


def test_nothing_differs_without_changes():
    assert Changes().empty
    assert not Changes(replaces_commands=True).empty
    assert (Changes() + Changes()).empty
