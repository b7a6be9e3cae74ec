"""The client of a running drill, against a drill in another process."""

import numpy as np
import pytest
from drill_client import stamps
from rpud_msgs.msg import JournalEntry, Result, WeightOnBit
from support import PATIENCE, until

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.client import DrillClient, NoAnswerError, NoDrillError, RefusedError

PAUSED = {"start_paused": True, "publish_clock": True}


@pytest.fixture(scope="module")
def process(start_module_drill):
    return start_module_drill("/bench", node="left_drill", **PAUSED)


@pytest.fixture
def drill(process):
    with DrillClient("/bench", patience=PATIENCE) as drill:
        drill.pause()
        drill.reset()
        yield drill


def test_a_command_is_over_when_the_drill_has_accepted_it(drill):
    journal = drill.listen("journal")
    before = len(journal)
    for number in range(20):
        force = 11.0 + number
        drill.press(force)
        assert drill.status.weight_on_bit == force
        assert drill.status.commands_accepted == number + 1
        drill.step(0.01)
    drill.until(lambda: len(journal) >= before + 20)
    kinds = [entry.kind for entry in journal]
    assert kinds.count(JournalEntry.KIND_WEIGHT_ON_BIT) == 20
    drill.drive(False)
    assert not drill.status.drive_enabled
    drill.drive(True, frequency=15900.0)
    shown = drill.status
    assert (shown.drive_voltage, shown.drive_frequency) == (100.0, 15900.0)


def test_a_command_waits_for_the_drill_and_for_all_others_that_hear_it(drill):
    with DrillClient("/bench") as recorder:
        heard = recorder.listen("command/weight_on_bit", WeightOnBit)
        drill.press(13.0)  # the first one of this client
        recorder.until(lambda: heard)
        assert heard[0].force == 13.0


def test_a_refused_command_raises_the_reason_of_the_drill(drill):
    with pytest.raises(RefusedError, match=r"^weight_on_bit = -1 N is outside its range \[0, 1"):
        drill.press(-1.0)
    with pytest.raises(RefusedError, match=r"^drive voltage = nan V is outside its range"):
        drill.drive(True, voltage=float("nan"))
    assert drill.status.commands_rejected == 2
    assert drill.status.commands_accepted == 0


@pytest.mark.parametrize(
    ("act", "text"),
    [
        (lambda drill: drill.press("20"), "force = '20' is not a number"),
        (lambda drill: drill.press(True), "force = True is not a number"),
        (lambda drill: drill.drive("off"), "drive enabled = 'off' is not true or false"),
        (lambda drill: drill.engage("no"), "engage = 'no' is not true or false"),
        (lambda drill: drill.set_parameters(gravity=1j), "gravity = 1j is of no type of ROS"),
        (lambda drill: drill.inject("lost_preload", duration=0), "duration = 0 s is outside"),
        (lambda drill: drill.inject("lost_preload", duration=1e-12), "duration = 1e-12 s is out"),
    ],
)
def test_an_argument_of_another_type_is_not_sent(drill, act, text):
    with pytest.raises(ParameterError, match=text):
        act(drill)
    assert (drill.status.commands_rejected, drill.status.active_faults) == (0, 0)


def test_numbers_of_numpy_are_sent_and_the_node_may_have_another_name(drill):
    drill.press(np.int64(20))
    drill.set_parameters(gravity=np.float32(1.5), command_loss_ramp=np.int64(2))
    assert drill.status.weight_on_bit == 20.0
    assert drill.publishers == ["/bench/left_drill"]
    assert drill.journal(0)[-1].kind == JournalEntry.KIND_CONFIGURE


def test_the_refusal_of_another_publisher_is_not_taken_for_its_own(drill):
    other = drill.node.create_publisher(WeightOnBit, "command/weight_on_bit", 10)
    drill.until(other.get_subscription_count)
    drill.press(24.0)
    drill.until(lambda: drill.status.commanders == 2)
    other.publish(WeightOnBit(force=-3.0))
    drill.press(25.0)
    assert drill.status.weight_on_bit == 25.0
    drill.until(lambda: drill.status.commands_rejected == 1)
    drill.node.destroy_publisher(other)


def test_a_step_is_over_when_all_its_messages_are_there(drill):
    forces, impacts = drill.listen("reacting_force"), drill.listen("contact_force")
    for number in range(1, 11):
        assert drill.step(0.1) == drill.time == pytest.approx(0.1 * number)
        assert len(forces) == 10 * number
        if number == 1:
            before = drill.published["contact_force"] - len(impacts)
    assert drill.published["contact_force"] - before == len(impacts) > 0
    told = drill.delivery()
    published = dict(zip(told.topics, told.published, strict=True))
    for name in ("power", "status", "timing"):  # which a paused drill goes on to publish
        del published[name]
    assert drill.published.items() >= published.items()
    assert drill.step(0.001234567) == 1.001234567
    assert drill.run_to(1.5) == 1.5
    assert stamps(forces) == [number * 10_000_000 for number in range(1, 151)]
    assert [each.sequence for each in impacts] == list(range(len(impacts)))
    with pytest.raises(RefusedError, match=r"is not after the drill's time") as refused:
        drill.run_to(1.5)
    assert refused.value.result == Result.RESULT_OPERATION_FAILED
    with pytest.raises(ParameterError, match=r"scope = 'al' is unknown; did you mean all?"):
        drill.reset("al")


def test_a_magnitude_of_zero_is_zero_where_that_is_one(drill):
    drill.inject("wrong", "wrench", 0.0)
    assert 0.0 < drill.faults[-1].magnitude < 1e-200
    drill.inject("free_mass_jammed", magnitude=0.0)
    with pytest.raises(ParameterError, match="magnitude of bias on wrench = 0 would change noth"):
        drill.inject("bias", "wrench", 0.0)


def test_without_a_drill_it_says_where_there_are_some(process, monkeypatch):
    with DrillClient("/bench") as there, DrillClient("/bensh", patience=1.0) as drill:
        there.found(PATIENCE)
        with pytest.raises(NoDrillError, match=r"^no drill in /bensh .*; there is one in /bench"):
            drill.press(1.0)
    with DrillClient("/bench", domain_id=0, patience=0.5) as drill:
        monkeypatch.setenv("ROS_DISCOVERY_SERVER", ":1")
        expected = (
            r"^no drill in /bench of ROS domain 0 within 0.5 s; .* at ROS_DISCOVERY_SERVER=:1"
        )
        with pytest.raises(NoDrillError, match=expected):
            drill.press(1.0)


def test_what_it_waits_for_in_vain_has_a_time_limit(drill):
    with pytest.raises(NoAnswerError, match=r"^nothing moved within 0.1 s$"):
        drill.until(lambda: drill.time > 1.0, patience=0.1, what="nothing moved")
    with pytest.raises(NoAnswerError, match=r"^no topic /bench/nothing within 0.2 s; "):
        drill.listen("nothing", patience=0.2)


@pytest.mark.extended
def test_two_living_drills_are_refused_a_killed_one_is_not_and_none_is_noticed(start_drill):
    first = start_drill("/twins", **PAUSED)
    second = start_drill("/twins", **PAUSED)
    first.wait_for_line("WARN.*: 2 nodes are named /twins/drill_node: all of them answer the same")
    with DrillClient("/twins", patience=PATIENCE) as drill:
        until(lambda: drill.node.count_publishers("/twins/status") == 2)
        with pytest.raises(NoDrillError, match=r"2 nodes publish /twins/status"):
            drill.press(20.0)
    second.kill()
    second.wait()
    with DrillClient("/twins", patience=1.0) as drill:
        drill.found(PATIENCE)
        drill.press(20.0)
        assert drill.status.weight_on_bit == 20.0
        first.kill()
        first.wait()
        with pytest.raises(NoAnswerError, match=r"did not accept the command within 1 s"):
            drill.press(30.0)
        with pytest.raises(NoAnswerError, match=r"/twins/simulation/step did not answer within"):
            drill.step(1.0)
