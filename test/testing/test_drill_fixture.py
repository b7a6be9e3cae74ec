"""The drill of a test: these tests use the fixtures as any user does."""

import os
import signal
from pathlib import Path

import pytest
from rpud_msgs.msg import Status

import rpud_sim.bag
from rpud_sim.drilling.rock import Strata, preset_layer
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.recorded.verify import verify
from rpud_sim.ros.client import DrillClient, RefusedError
from rpud_sim.testing import ExpectationFailedError, SystemUnderTestError
from rpud_sim.testing.artefacts import write_bag
from rpud_sim.testing.setup import drill_setup
from rpud_sim.verdicts import Expectation, Record, always, evaluate
from rpud_sim.verdicts import signal as field

HEARTBEAT = "supervisor/heartbeat"
SIGNALS = ("reacting_force", "contact_force", "wrench", "drill_tool", "nodal_plane", HEARTBEAT)


def supervise(drill, how="works", timeout=20.0, answers=HEARTBEAT):
    drill.with_answers(answers, timeout=timeout)
    remap = ("--ros-args", "-r", f"__ns:={drill.namespace}")
    return drill.start(
        "python", "../helpers/supervisor.py", how, *remap, subscribes_to=("reacting_force",)
    )


def content(drill, topics=SIGNALS):
    heard = drill.heard
    return {
        name: list(heard[f"{drill.namespace}/{name}"].payloads)
        for name in topics
        if f"{drill.namespace}/{name}" in heard
    }


def test_a_step_is_over_when_everything_is_there(drill):
    assert drill.time == 0.0
    for _ in range(3):
        drill.step(0.123)
        assert drill.status.header.stamp.nanosec == round(drill.time * 1e9)
        assert len(drill.messages("reacting_force")) == int(drill.time * 100)
        impacts = drill.messages("contact_force")
        assert [impact.sequence for impact in impacts] == list(range(len(impacts)))
        # An impact that has begun counts, and is published at its end.
        assert 0 <= drill.status.impacts - len(impacts) <= 1
    assert drill.time == pytest.approx(0.369)


def test_nothing_leaks_into_the_next_test(pool):
    setup = drill_setup({"weight_on_bit": 12.0})
    drill = pool.take(setup)
    impacts, fresh = drill.status.impacts, content(drill)
    drill.step(0.3)
    first = content(drill)
    pool.give_back(drill)

    noisy = drill_setup({"weight_on_bit": 12.0, "faults": "free_mass_jammed", "seed": 9})
    assert pool.take(noisy) is drill
    drill.step(0.1)
    assert drill.status.active_faults == 1
    drill.set_parameters(load_spring_rate=20000.0, command_timeout=2.0, real_time_factor=3.0)
    drill.press(40.0)
    drill.drive(False)
    drill.engage(False)
    drill.inject("lost_preload")
    drill.listen("/talk", "std_msgs/msg/String")
    drill.listen("waveform")
    drill.step(0.2)
    DrillClient.play(drill.client)
    pool.give_back(drill)

    assert pool.take(setup) is drill
    status = drill.status
    assert (status.state, status.regime) == (Status.STATE_PAUSED, Status.REGIME_DRILLING)
    assert (status.weight_on_bit, status.drive_enabled) == (12.0, True)
    assert (status.active_faults, status.impacts, status.commands_accepted) == (0, impacts, 0)
    assert content(drill) == fresh
    assert drill.log == []
    assert "/talk" not in drill.heard
    drill.step(0.3)
    assert content(drill) == first
    pool.give_back(drill)


def test_one_process_serves_other_parameters_as_one_that_was_started_with_them(pool):
    others = drill_setup({"feed_model": "arm", "telemetry_rate": 200.0, "faults": "feed_stall"})
    fresh = pool.take(others)
    fresh.step(0.3)
    expected = {name: each.payloads for name, each in fresh.heard.items() if "status" not in name}
    fresh.close()

    drill = pool.take(drill_setup({"weight_on_bit": 12.0}))
    pid = drill.pid
    drill.set_parameters(command_timeout=2.0)
    drill.press(40.0)
    drill.listen("reacting_force")
    drill.step(0.2)
    pool.give_back(drill)
    again = pool.take(others)
    assert again.pid == pid
    again.step(0.3)
    found = {name: each.payloads for name, each in again.heard.items() if "status" not in name}
    assert sorted(found) == sorted(expected)
    different = [name for name in found if found[name] != expected[name]]
    assert different == []
    assert again.status.commands_accepted == 0
    pool.give_back(again)


def test_in_quick_steps_each_status_has_its_power_and_timing(pool):
    drill = pool.take(drill_setup({}))
    for topic in ("power", "timing"):
        drill.listen(topic)
    for number in range(20):
        drill.press(10.0 + number)
        drill.step(0.001)
    # Each command and each step has a status. A report between the two listens is of the first.
    power, timing = (drill.messages(topic)[-40:] for topic in ("power", "timing"))
    assert len(power) == len(timing) == 40
    assert [each.header for each in power] == [each.header for each in timing]
    assert power[-1].header == drill.status.header
    pool.give_back(drill)


def test_a_dead_drill_is_replaced_and_told_of(pool):
    drill = pool.take(drill_setup({}))
    os.kill(drill.pid, signal.SIGKILL)
    with pytest.raises(RuntimeError, match="the drill was ended by SIGKILL"):
        drill.step(0.1)
    pool.give_back(drill)
    other = pool.take(drill_setup({}))
    assert other is not drill
    assert other.step(0.1) == 0.1
    pool.give_back(other)


def test_a_node_that_answers_is_stepped_with_and_always_alike(drill, drill_factory):
    found = []
    for each in (drill, drill_factory()):
        supervise(each)
        each.step_until(lambda each=each: each.status.weight_on_bit > 20.0, timeout=10.0)
        commands = each.messages("command/weight_on_bit")
        assert len(commands) == len(each.messages(HEARTBEAT)) == round(each.time * 10)
        assert each.status.commands_accepted == len(commands)
        assert each.status.weight_on_bit == commands[-1].force
        found.append((each.time, content(each)))
    assert drill.domain != each.domain
    assert found[0] == found[1]


@pytest.mark.extended
def test_a_command_that_does_not_reach_the_drill_is_told_before_the_first_step(drill):
    drill.press(10.0)  # that one publisher reaches it does not hide that another one does not
    drill.step(0.1)
    command = f"python ../helpers/supervisor.py unheard --ros-args -r __ns:={drill.namespace}"
    expected = r"not connected to the drill on command/weight_on_bit within 5 s"
    with pytest.raises(SystemUnderTestError, match=expected):
        drill.start(command, subscribes_to=("reacting_force",), timeout=5.0)


def test_the_test_itself_is_not_asked_for_answers(drill):
    supervise(drill, answers="command/weight_on_bit")
    assert drill.step(0.2) == drill.time


def test_what_is_expected_is_evaluated_on_what_was_published(drill, tmp_path):
    drill.step(0.5)
    drill.press(30.0)
    drill.step_until(field("reacting_force.force") > "29 N", timeout=2.0)
    bearable = Expectation("bearable", always(field("reacting_force.force") < "5 N"), "R1")
    with pytest.raises(
        ExpectationFailedError, match=r"\[R1\] bearable: failed: reacting_force\.force was "
    ) as error:
        drill.expect(bearable)
    assert "rejected" not in str(error.value)
    drill.step(0.5)
    [verdict] = drill.expect(always(field("status.weight_on_bit") < "31 N"), requirement="R2")
    assert verdict.passed
    assert verdict.name == "always(status.weight_on_bit < 31 N)"
    assert [each.requirement for each in drill.verdicts] == ["R1", "R2"]

    write_bag(tmp_path / "bag", drill)
    record = Record.from_bag(tmp_path / "bag", bearable.topics)
    with pytest.raises(ExpectationFailedError) as error:
        drill.expect(bearable)
    assert evaluate(bearable, record) == error.value.verdicts[0]
    assert verify(tmp_path / "bag").proved


def test_the_bag_of_a_test_contains_the_strata_after_a_reset(drill_factory, tmp_path):
    layers = tuple(preset_layer("limestone", 1e-3 * number) for number in range(20))
    drill = drill_factory(strata=Strata(layers).to_text())
    drill.step(0.05)
    drill.reset()
    drill.step(0.05)
    write_bag(tmp_path / "bag", drill)
    assert verify(tmp_path / "bag").proved


def test_a_recording_is_complete_and_can_be_proved(drill, recording):
    drill.step(0.2)
    drill.press(25.0)
    drill.step(0.2)
    bag = recording.stop()
    assert bag == Path(recording)
    with rpud_sim.bag.open(bag) as opened:
        counts = {each.topic.name: each.message_count for each in opened.topics}
    assert counts["/rpud/reacting_force"] == 40
    assert counts["/rpud/contact_force"] == drill.status.impacts
    assert verify(bag).proved


@pytest.mark.parametrize(
    ("action", "text"),
    [
        (lambda drill: drill.latest("reacting_forc"), "did you mean reacting_force"),
        (lambda drill: drill.messages("/talk"), r"call listen\('/talk'\) first"),
        (lambda drill: drill.listen("/silent"), "no publisher on /silent; give its type"),
        (lambda drill: drill.listen("nodal_plan"), r"give its type; did you mean nodal_plane\?"),
        (lambda drill: drill.listen(""), "topic = '' is not allowed: topic name must not be empty"),
        (lambda drill: drill.messages("a//b"), "topic = 'a//b' is not allowed: .* repeated '/'"),
        (lambda drill: drill.with_answers("a b"), "topic = 'a b' is not allowed: .* characters"),
        (lambda drill: drill.with_answers(5), "topic = 5 is not allowed: it is not a text"),
        (lambda drill: drill.listen("\udce9"), "is not allowed: it is not UTF-8"),
        (lambda drill: drill.start(""), r"start takes a command, not \(''"),
        (lambda drill: drill.start(), r"start takes a command, not \(\)"),
        (lambda drill: drill.step(-1.0), "step = -1 s is outside its range"),
        (lambda drill: drill.step_until(lambda: 1, 0.0), "timeout = 0 s is outside its range"),
        (lambda drill: drill.with_answers("/a", count=0), "count = 0 is outside its range"),
        (lambda drill: drill.with_answers("/a", timeout=float("nan")), "timeout = nan"),
    ],
)
def test_wrong_calls_are_refused_in_one_line(drill, action, text):
    with pytest.raises(ParameterError, match=text) as error:
        action(drill)
    assert "\n" not in str(error.value)
    assert drill.time == 0.0


@pytest.mark.parametrize("name", ["weight_on_bit", "press", "time", "seed"])
def test_what_does_nothing_cannot_be_set(drill, name):
    for face in (drill, drill.client):
        with pytest.raises(AttributeError, match=f"^{name} of a .* cannot be set$"):
            setattr(face, name, 30.0)
    assert drill.status.weight_on_bit == 8.0


HERE = "the drill at {:.3f} s: state paused, regime drilling, weight on bit 8 N, drive on, 0 faults"


def test_what_never_comes_true_is_named_with_the_values_and_the_state_of_the_drill(drill):
    with pytest.raises(AssertionError) as error:
        drill.step_until(lambda: drill.status.impacts < 0, timeout=0.2)
    awaited, state = str(error.value).splitlines()
    assert awaited.startswith("the condition of test_drill_fixture.py:")
    assert awaited.endswith(" did not come true within 0.2 s of simulation time")
    assert state == HERE.format(0.2)
    with pytest.raises(AssertionError) as error:
        drill.step_until(field("status.weight_on_bit") > "20 N", timeout=0.3)
    assert str(error.value).splitlines() == [
        "status.weight_on_bit > 20 N did not come true within 0.3 s of simulation time: "
        "status.weight_on_bit was 8 N at 0.5 s",
        HERE.format(0.5),
    ]


def test_a_failure_counts_refused_commands_and_has_the_reason_of_the_last(drill):
    reason = "weight_on_bit = -2 N is outside its range [0, 1000] N"
    assert drill.refusals == ""
    for force in (-1.0, -2.0):
        with pytest.raises(RefusedError):
            drill.press(force)
    assert drill.refusals == f"2 commands rejected, the last: {reason}"
    drill.step(0.1)
    for fail in (
        lambda: drill.step_until(lambda: False, timeout=0.1),
        lambda: drill.expect(always(field("reacting_force.force") < "0 N")),
    ):
        with pytest.raises(AssertionError) as error:
            fail()
        assert str(error.value).splitlines()[-1] == drill.refusals
    drill.reset()
    assert drill.refusals == ""
    with pytest.raises(RefusedError):
        drill.press(-2.0)
    assert drill.refusals == f"1 command rejected, the last: {reason}"


@pytest.mark.rpud(seed=3, faults=[{"kind": "free_mass_jammed", "onset": 0.2}], weight_on_bit=20.0)
def test_a_mark_describes_the_drill(drill, drill_factory):
    drill.step(0.1)
    assert (drill.status.weight_on_bit, drill.status.active_faults) == (20.0, 0)
    drill.step(0.2)
    assert [fault.kind for fault in drill.latest("faults").faults] == ["free_mass_jammed"]
    other = drill_factory(seed=4)
    other.step(0.1)
    assert other.status.weight_on_bit == 20.0
    assert other.messages("nodal_plane")[0] != drill.messages("nodal_plane")[0]
