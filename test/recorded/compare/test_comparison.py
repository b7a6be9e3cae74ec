"""Bags side by side: which runs they are, what was done to them, their bits and metrics."""

import json
import math

import pytest
from altered_bags import altered, flipped, merged, numbered, unchanged
from sample_bags import write_offline_bag
from support import called, extended

import rpud_sim.bag as bags
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.columns import to_plain
from rpud_sim.messages.definitions import installed_codec
from rpud_sim.recorded import RecordingError, streams
from rpud_sim.recorded.compare import compare
from rpud_sim.recorded.compare.metrics import DIFFERS
from rpud_sim.simulation import preset, read_scenario

DRILLING = preset("drilling")
SHIFT = 1_700_000_000 * SECOND
COMMANDS = "commands: [{{time: 0.5, weight_on_bit: 12}}, {{time: {}, drive: {{enabled: false}}}}]"
FAULT = "faults: [{kind: bias, channel: wrench, magnitude: 3, onset: 0.2, duration: 0.1}]"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")
    (folder / "faults.yaml").write_text(FAULT)
    scenario = read_scenario(folder / "faults.yaml")
    for name, parameters, phase, scene in (
        ("a", DRILLING, 0.1, ()),
        ("again", DRILLING, 0.1, ()),
        ("other", DRILLING, 0.6, ()),
        ("heavier", DRILLING.replace(weight_on_bit=20.0), 0.6, ()),
        ("faulty", DRILLING, 0.1, scenario),
    ):
        write_offline_bag(folder / name, parameters, 2.0, phase, scene)
    return folder


def states(found):
    return {topic.topic: topic.state for topic in found.bits}


# --- bits --------------------------------------------------------------------------------------


def test_a_run_made_twice_has_equal_bits(made):
    found = compare([made / "a", made / "again"])
    assert found.equal_bits
    assert set(states(found).values()) == {"equal"}
    assert found.settings == ()
    assert not found.differs
    assert not found.undecided
    assert all(each.reference == each.other for each in found.metrics)


def test_the_block_that_the_end_of_a_run_cuts_off_is_equal_as_far_as_it_goes(made, tmp_path):
    write_offline_bag(tmp_path / "short", DRILLING, 0.63, 0.1)
    for pair in ([made / "a", tmp_path / "short"], [tmp_path / "short", made / "a"]):
        found = compare(pair, begin=0.0)
        assert found.equal_bits
        assert set(states(found).values()) == {"equal"}
    middle = numbered("waveform", 12, lambda m: [flipped(m.data, len(m.data) // 2)])  # the last one
    path = altered(tmp_path / "short", tmp_path / "altered", middle)
    found = states(compare([made / "a", path], begin=0.0))
    assert [topic for topic, state in found.items() if state != "equal"] == ["waveform"]


def test_the_first_difference_is_found_to_the_field(made, tmp_path):
    codec = installed_codec("rpud_msgs/msg/ReactingForce")

    def change(message):
        if message.topic == "/rpud/reacting_force" and message.log_time == SECOND:
            fields = to_plain(codec.decode(message.data))
            return [codec.encode({**fields, "force": math.nextafter(fields["force"], 1e9)})]
        return unchanged(message)

    found = compare([made / "a", altered(made / "a", tmp_path / "altered", change)])
    [topic] = [each for each in found.bits if each.state == "different"]
    assert (topic.topic, topic.time, topic.field) == ("reacting_force", 1.0, "force")
    assert topic.messages == 99
    assert float(topic.other) == math.nextafter(float(topic.reference), 1e9)
    assert not found.equal_bits


@pytest.mark.parametrize(
    ("part", "most"),
    [
        ("early", 64 * 2**20),
        ("late", 10_000),
        extended("early", 10_000),
        extended("late", 64 * 2**20),
    ],
)
def test_a_recording_of_a_part_is_compared_as_far_as_it_goes(
    made, tmp_path, monkeypatch, part, most
):
    def kept(message):
        early = message.log_time < SECOND // 2
        return [message.data] if early == (part == "early") or "journal" in message.topic else []

    monkeypatch.setattr(streams, "_MOST_WAITING", most)
    path = altered(made / "a", tmp_path / "part", kept)
    for pair in ((made / "a", path), (path, made / "a")):
        found = compare(pair, begin=0.1)
        assert "different" not in states(found).values()
        assert states(found)["nodal_plane"] == states(found)["contact_force"] == "equal"
        spans = {"early": (0.1, 0.5), "late": (0.5, 2.0)}
        assert (found.begin, found.end) == pytest.approx(spans[part], abs=0.1)


def test_bits_are_equal_whatever_the_wall_clock_was(made, tmp_path):
    """Two runs in front of ROS have other stamps: those count from the origin of each."""
    with bags.open(made / "a") as bag:
        codecs = {s.topic.name: Codec(s.topic.type, s.definition) for s in bag.topics}

    def change(message):
        codec = codecs[message.topic]
        fields = codec.decode(message.data)
        for time in [fields.header.stamp, *([fields.origin] if hasattr(fields, "origin") else [])]:
            time.sec += SHIFT // SECOND
        if message.topic.endswith("journal") and fields.kind == "origin":
            fields.content = json.dumps({**json.loads(fields.content), "origin": SHIFT})
        return [codec.encode(fields)]

    stamped = altered(made / "a", tmp_path / "stamped", change)
    path = merged(tmp_path / "shifted", (stamped, SHIFT, "/rpud"))
    found = compare([made / "a", path])
    assert found.equal_bits
    assert found.runs[1].end == found.runs[0].end
    assert states(compare([path, made / "other"]))["contact_force"] == "different"


# --- runs --------------------------------------------------------------------------------------


def test_other_parameters_are_named_and_their_effect_is_found(made):
    found = compare([made / "a", made / "heavier"])
    assert set(found.settings) == {
        ("initial_phase", "cycles", ("0.1", "0.6")),
        ("weight_on_bit", "N", ("8", "20")),
    }
    differing = [each for each in found.metrics if each.result == DIFFERS]
    assert any(each.relative_low > 0.1 or each.relative_high < -0.1 for each in differing)
    assert found.differs
    assert not compare([made / "a", made / "other"]).differs
    with bags.open(made / "a") as bag:
        stamps = bag.arrays("/rpud/contact_force")["header.stamp"]
    begin, end = found.begin, found.end
    count = ((stamps >= begin * SECOND) & (stamps < end * SECOND)).sum()
    [rate] = [each.reference for each in found.metrics if each.quantity == "impact_rate"]
    assert rate == pytest.approx(count / (end - begin), rel=0.005)


def test_commands_and_faults_that_differ_are_settings(made, tmp_path, capsys):
    paths = []
    for number, later in enumerate((1.0, 1.2)):
        file = tmp_path / f"{number}.yaml"
        file.write_text(COMMANDS.format(later))
        paths.append(tmp_path / f"forked{number}")
        words = ("--at", "0.4", "--commands", file, "--out", paths[-1])
        assert called(capsys, "fork", made / "a", *words)[0] == 0
    drive = [each for each in compare(paths).settings if "drive" in each.name]
    assert [each.values for each in drive] == [("at 1.400000 s", ""), ("", "at 1.600000 s")]
    weight, _ = compare([made / "a", paths[0]]).settings
    assert weight == ("weight_on_bit: force 12", "", ("", "at 0.900000 s"))
    found = [
        each for each in compare([made / "a", made / "faulty"]).settings if "bias" in each.name
    ]
    [(name, _, times)] = found
    assert name.startswith("fault bias: channel wrench, magnitude 3")
    assert times == ("", "at 0.200000 s")


def test_a_run_of_several_is_chosen(made, tmp_path):
    later = 10 * SECOND
    path = merged(tmp_path / "two", (made / "a", 0, "/rpud"), (made / "other", later, "/rpud"))
    found = compare([path, made / "a"])
    assert found.equal_bits
    assert any("holds 2 runs: the first is compared" in text for text in found.warnings)
    found = compare([path, path], run_numbers=[1, 2])
    assert states(found)["contact_force"] == "different"
    assert found.names == (f"{path} /rpud run 1", f"{path} /rpud run 2")
    assert found.runs[1].begin < 0.1
    with pytest.raises(RecordingError, match=r"run = 3 is outside its range \[1, 2\]"):
        compare([path, path], run_numbers=[3])
    path = merged(tmp_path / "twice", (made / "a", 0, "/rpud"), (made / "a", later, "/rpud"))
    assert compare([path, path], run_numbers=[1, 2]).equal_bits


def test_a_drill_of_several_is_chosen(made, tmp_path):
    path = merged(tmp_path / "both", (made / "a", 0, "/left"), (made / "other", 0, "/right"))
    with pytest.raises(RecordingError, match="several drills: choose --namespace of /left, /right"):
        compare([path, made / "a"])
    with pytest.raises(RecordingError, match="did you mean /left"):
        compare([path, made / "a"], namespaces=["lefd", None])
    assert compare([path, made / "a"], namespaces=["left", None]).equal_bits
    found = compare([path, path], namespaces=["/left", "/right/"])
    assert states(found)["contact_force"] == "different"


def test_a_bag_without_journal_is_compared_by_its_stamps(made, tmp_path):
    names = {f"/rpud/{name}" for name in ("contact_force", "nodal_plane")}
    path = altered(made / "a", tmp_path / "bare", unchanged, names)
    found = compare([path, made / "other"], begin=0.1)
    assert any("holds no journal" in text for text in found.warnings)
    quantities = {each.quantity for each in found.metrics}
    assert "peak_force" in quantities
    assert "reacting_force" not in quantities
    assert states(found)["waveform"] == "not compared"
    bare = altered(made / "a", tmp_path / "without values", unchanged, {"/rpud/drill_tool"})
    found = compare([made / "a", bare])
    assert {each.topic for each in found.bits if each.note == ""} == {"drill_tool"}


# --- views of the result -----------------------------------------------------------------------


def test_runs_whose_messages_show_no_time_are_compared_by_their_bits(made, tmp_path, capsys):
    cut = altered(made / "a", tmp_path / "cut", lambda message: [message.data[:9]])
    code, out, err = called(capsys, "compare", cut, cut)
    assert (code, out.splitlines()[-1]) == (3, "equal bits: the runs are the same")
    assert "cut (1): no message shows its time" in err
    page = tmp_path / "page.html"
    code, out, _ = called(capsys, "compare", cut, made / "a", "--out", page)
    assert (code, "not decided: record longer runs" in out, page.exists()) == (3, True, True)
    assert "nan" not in out.split()
    assert "inf" not in out.split()
