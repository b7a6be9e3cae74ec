"""Bags side by side: which runs they are, what was done to them, their bits and their figures."""

import dataclasses
import json
import math

import numpy as np
import pytest
from altered_bags import altered, unchanged
from sample_bags import write_offline_bag
from support import called

import rpud_sim.bag as bags
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection import InspectionError
from rpud_sim.inspection.compare import compare, same_bits
from rpud_sim.inspection.compare.estimates import DIFFERS
from rpud_sim.inspection.compare.results import content
from rpud_sim.inspection.compare.values import RecordedValues
from rpud_sim.inspection.recorded_journal import installed_codec
from rpud_sim.simulation import preset, read_scenario

DRILLING = preset("drilling")
DURATION = 2.0
SHIFT = 1_700_000_000 * SECOND
COMMANDS = (
    "commands: [{{time: 0.5, weight_on_bit: 12}}, {{time: {later}, drive: {{enabled: false}}}}]"
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")
    for name, parameters, phase in (
        ("a", DRILLING, 0.1),
        ("again", DRILLING, 0.1),
        ("other", DRILLING, 0.6),
        ("heavier", DRILLING.replace(weight_on_bit=20.0), 0.6),
    ):
        write_offline_bag(folder / name, parameters, DURATION, phase)
    return folder


def states(found, number=0):
    return {topic.topic: topic.state for topic in found.bits[number]}


def test_a_run_made_twice_has_equal_bits(made):
    found = compare([made / "a", made / "again"])
    assert found.equal_bits
    assert set(states(found).values()) == {"equal"}
    assert (found.parameters, found.versions, found.commands, found.faults) == ((), (), (), ())
    assert not found.differs
    assert not found.undecided
    assert found.verdict == "equal bits: the runs are the same"
    assert {each.value for each in found.differences if each.low == each.low} == {0.0}


def test_the_first_difference_is_found_to_the_field(made, tmp_path):
    codec = installed_codec("rpud_msgs/msg/ReactingForce")

    def change(message):
        if message.topic == "/rpud/reacting_force" and message.log_time == SECOND:
            fields = dataclasses.asdict(codec.decode(message.data))
            return [codec.encode({**fields, "force": math.nextafter(fields["force"], 1e9)})]
        return unchanged(message)

    path = altered(made / "a", tmp_path / "altered", change)
    found = compare([made / "a", path])
    [topic] = [each for each in found.bits[0] if each.state == "different"]
    assert (topic.topic, topic.time, topic.field) == ("reacting_force", 1.0, "force")
    assert topic.messages == 99
    assert float(topic.other) == math.nextafter(float(topic.reference), 1e9)
    assert not found.equal_bits


def test_a_missing_message_is_a_difference_and_a_late_recorder_is_none(made, tmp_path):
    def lost(message):
        return [] if message.log_time == SECOND and "nodal" in message.topic else [message.data]

    def late(message):
        early = message.log_time < SECOND // 2 and "journal" not in message.topic
        return [] if early else [message.data]

    found = compare([made / "a", altered(made / "a", tmp_path / "lost", lost)])
    [topic] = [each for each in found.bits[0] if each.state == "different"]
    assert (topic.topic, topic.time) == ("nodal_plane", 1.0)
    assert (topic.reference, topic.other) == ("a message", "nothing at this time")
    found = compare([made / "a", altered(made / "a", tmp_path / "late", late)])
    assert states(found)["nodal_plane"] == "equal"
    assert states(found)["contact_force"] == "equal"
    assert found.windows[0].begins[0] >= 0.5


def test_a_run_that_goes_on_longer_waits_for_nobody(made, tmp_path, monkeypatch):
    monkeypatch.setattr(same_bits, "_MOST_WAITING", 1_200_000)

    def early(message):
        return [message.data] if message.log_time < SECOND // 2 else []

    path = altered(made / "a", tmp_path / "early", early)
    for pair in ((made / "a", path), (path, made / "a")):
        assert "different" not in states(compare(pair, settle=0.1)).values()


def test_bits_are_equal_whatever_the_wall_clock_was(made, tmp_path):
    """Two runs in front of ROS have other stamps: those count from the origin of each."""
    with bags.open(made / "a") as bag:
        codecs = {s.topic.name: Codec(s.topic.type, s.definition) for s in bag.topics}

    def change(message):
        codec = codecs[message.topic]
        fields = codec.decode(message.data)
        times = [fields.header.stamp]
        if message.topic.endswith("trajectory"):
            times.append(fields.origin)
        for time in times:
            time.sec += SHIFT // SECOND
        if message.topic.endswith("journal") and fields.kind == "origin":
            fields.content = json.dumps({**json.loads(fields.content), "origin": SHIFT})
        data = bytes(codec._store.serialize_cdr(fields, codec.type_name))
        return (message.topic, data, message.log_time + SHIFT, message.publish_time + SHIFT)

    path = tmp_path / "shifted"
    with bags.open(made / "a") as reader, bags.BagWriter(path) as writer:
        for summary in reader.topics:
            writer.add_topic(summary.topic, summary.definition)
        for message in reader.messages():
            writer.write(*change(message))
    found = compare([made / "a", path])
    assert found.equal_bits
    assert found.values[1].end == found.values[0].end
    assert not compare([path, made / "other"]).equal_bits


def test_other_parameters_are_named_and_their_effect_is_found(made):
    found = compare([made / "a", made / "heavier", made / "other"])
    assert {(each.name, each.unit, each.values) for each in found.parameters} == {
        ("initial_phase", "cycles", ("0.1", "0.6", "0.6")),
        ("weight_on_bit", "N", ("8", "20", "8")),
    }
    by_run = [
        [d for q in found.windows[0].quantities for d in q.differences[run]] for run in range(2)
    ]
    assert any(each.decision == DIFFERS and each.relative > 0.1 for each in by_run[0])
    assert not any(each.decision == DIFFERS for each in by_run[1])
    assert found.differs
    rate = next(q for q in found.windows[0].quantities if q.quantity == "impact_rate")
    with bags.open(made / "a") as bag:
        stamps = bag.arrays("/rpud/contact_force")["header.stamp"]
    begin, end = found.windows[0].begins[0], found.windows[0].ends[0]
    count = ((stamps >= begin * SECOND) & (stamps < end * SECOND)).sum()
    assert rate.runs[0].estimates["mean"].value == pytest.approx(count / (end - begin))


def test_commands_and_faults_are_aligned_and_divide_the_time(made, tmp_path):
    (tmp_path / "faults.yaml").write_text(
        "faults: [{kind: bias, channel: wrench, magnitude: 3, onset: 0.2, duration: 0.1}]"
    )
    scenario = read_scenario(tmp_path / "faults.yaml")
    paths = []
    for phase in (0.1, 0.7):
        path = tmp_path / f"faulty{phase}"
        write_offline_bag(path, DRILLING, 1.0, phase, scenario)
        paths.append(path)
    found = compare(paths, settle=0.02)
    [fault] = found.faults
    assert fault.text == "bias of wrench magnitude 3"
    assert (fault.times, fault.ends) == ((0.2, 0.2), (pytest.approx(0.3),) * 2)
    ends = [(w.begins[0], w.ends[0]) for w in found.windows]
    assert ends[0] == pytest.approx((0.02, 0.2))
    assert ends[1] == pytest.approx((0.32, 1.0), abs=0.01)
    found = compare([made / "a", paths[0]])
    assert [event.times for event in found.faults] == [(None, 0.2)]
    assert len(found.windows) == 1
    assert any("faults differ" in text for text in found.warnings)


def test_commands_that_differ_mix_causes(made, tmp_path, capsys):
    paths = []
    for number, later in enumerate((1.0, 1.2)):
        file = tmp_path / f"{number}.yaml"
        file.write_text(COMMANDS.format(later=later))
        paths.append(tmp_path / f"forked{number}")
        words = ("--at", "0.4", "--commands", file, "--out", paths[-1])
        assert called(capsys, "fork", made / "a", *words)[0] == 0
    found = compare(paths, settle=0.05)
    assert [event.times for event in found.commands] == [(0.9, 0.9), (1.4, 1.6)]
    assert len(found.windows) == 3
    found = compare([made / "a", paths[0]])
    assert [event.times[0] for event in found.commands] == [None, None]
    assert any("the commands differ" in text for text in found.warnings)


def two_runs(made, out):
    """Write a bag with two runs, as of a drill that was started twice."""
    with bags.BagWriter(out) as writer:
        shift = 0
        for number, name in enumerate(("a", "other")):
            with bags.open(made / name) as reader:
                for summary in reader.topics if number == 0 else ():
                    writer.add_topic(summary.topic, summary.definition)
                for m in reader.messages():
                    writer.write(m.topic, m.data, m.log_time + shift, m.publish_time + shift)
            shift += 10 * SECOND
    return out


def test_a_run_of_several_is_chosen(made, tmp_path):
    path = two_runs(made, tmp_path / "two")
    found = compare([path, made / "a"])
    assert found.equal_bits
    assert any("holds 2 runs: the first is compared" in text for text in found.warnings)
    found = compare([path, path], run_numbers=[1, 2])
    assert not found.equal_bits
    assert found.names == (f"{path} /rpud run 1", f"{path} /rpud run 2")
    assert found.values[1].begin < 0.1
    with pytest.raises(InspectionError, match=r"run = 3 is outside its range \[1, 2\]"):
        compare([path, path], run_numbers=[3])


def test_a_drill_of_several_is_chosen(made, tmp_path):
    path = tmp_path / "both"
    with bags.BagWriter(path) as writer:
        for name, space in (("a", "/left"), ("other", "/right")):
            with bags.open(made / name) as reader:
                for summary in reader.topics:
                    name = summary.topic.name.replace("/rpud", space)
                    writer.add_topic(bags.Topic(name, summary.topic.type), summary.definition)
                for m in reader.messages():
                    name = m.topic.replace("/rpud", space)
                    writer.write(name, m.data, m.log_time, m.publish_time)
    with pytest.raises(
        InspectionError, match="several drills: choose --namespace of /left, /right"
    ):
        compare([path, made / "a"])
    with pytest.raises(InspectionError, match="did you mean /left"):
        compare([path, made / "a"], namespaces=["lefd", None])
    assert compare([path, made / "a"], namespaces=["left", None]).equal_bits
    assert not compare([path, path], namespaces=["/left", "/right/"]).equal_bits


def test_a_bag_without_journal_is_compared_by_its_stamps(made, tmp_path):
    names = {f"/rpud/{name}" for name in ("contact_force", "nodal_plane")}
    path = altered(made / "a", tmp_path / "bare", unchanged, names)
    found = compare([path, made / "other"], settle=0.1)
    assert any("holds no journal" in text for text in found.warnings)
    quantities = [q.quantity for q in found.windows[0].quantities if any(q.differences)]
    assert "peak_force" in quantities
    assert "reacting_force" not in quantities
    assert states(found)["waveform"] == "not compared"


def test_too_short_a_time_decides_nothing(made):
    found = compare([made / "a", made / "other"], begin=1.0, end=1.11, settle=0.0)
    forces = [each for each in found.differences if each.quantity == "nodal_plane_position"]
    assert {each.decision for each in forces} == {"too few values"}
    assert {each.decision for each in found.differences if "power" in each.quantity} <= {
        "too few values",
        "no difference found",
    }


@pytest.mark.parametrize("option", [{"begin": -1.0}, {"tolerance": 1.0}])
def test_wrong_arguments_are_one_line(made, option):
    with pytest.raises(ParameterError, match=r".* = -?1\.0 .*is outside its range \[0, "):
        compare([made / "a", made / "a"], **option)


def test_the_content_is_json_without_nan(made):
    found = compare([made / "a", made / "heavier"])
    text = json.dumps(content(found), allow_nan=False)
    plain = json.loads(text)
    assert plain["differs"] is True
    assert plain["runs"][0]["end"] == found.values[0].end
    first = plain["windows"][0]["quantities"][0]
    assert first["quantity"] == "impact_rate"
    assert first["runs"][0]["mean"]["low"] < first["runs"][0]["mean"]["high"]
    assert {"p", "decision", "relative_low"} <= first["differences"][0][0].keys()


@pytest.mark.parametrize(
    ("numbers", "missing"), [([4, 6, 6, 7], 1), ([7, 5], 1), ([2**64 - 1, 2**64 - 1], 0)]
)
def test_missing_impacts_are_counted_in_any_order(numbers, missing):
    arrays = {"time": np.zeros(len(numbers)), "sequence": np.array(numbers, np.uint64)}
    assert RecordedValues(None, {"contact_force": arrays}).missing_impacts == missing
