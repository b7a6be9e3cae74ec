"""A drill goes back to a checkpoint, and its bag proves what follows."""

import pytest
from drill_client import Client, end, nanoseconds
from rpud_msgs.msg import Drive, Result, Status, WeightOnBit
from sample_bags import PLAIN_PROVED, proved_messages
from support import Process

import rpud_sim.bag
from rpud_sim.recorded.offline_bag import write_fork
from rpud_sim.recorded.recorded_journal import installed_codec
from rpud_sim.recorded.verify.verification import verify
from rpud_sim.simulation.topics import TOPICS

OPTIONS = {
    "start_paused": "true",
    "publish_clock": "true",
    "real_time_factor": "0.0",
    "actuator_model": "resonance",
    "rock_model": "specific_energy",
    "command_timeout": "1.0",
    "seed": "5",
}


def command(client, message, field, value):
    client.command(message)
    client.until(lambda: client.status and getattr(client.status[-1], field) == value)


@pytest.fixture(scope="module")
def used(start_module_drill, tmp_path_factory):
    """Record a drill that goes back twice; return the bag and what it answered."""
    folder = tmp_path_factory.mktemp("checkpoints")
    drill = start_module_drill("/rpud", **OPTIONS)
    with Process("rpud", "record", "--out", folder / "bag") as recorder, Client() as client:
        for topic in PLAIN_PROVED:
            recorder.wait_for_line(f"subscribed /rpud/{topic} ")
        answers = use(client)
        end(drill, recorder)
    return folder / "bag", answers


def use(client):
    client.step(0.1)
    command(client, WeightOnBit(force=20.0), "weight_on_bit", 20.0)
    assert client.inject("noise", "wrench", 0.5).success
    assert client.inject("hard_rock", seconds=0.1).success
    client.step(0.0534567)
    answers = {"saved": client.save("before")}
    client.step(0.15)
    command(client, Drive(enabled=True, voltage=60.0, frequency=16_000.0), "drive_voltage", 60.0)
    assert client.engage(False).success
    client.step(0.05)
    answers["restored"] = client.restore("before")
    client.until(lambda: client.status[-1].drive_voltage != 60.0)
    answers["status"] = client.status[-1]
    client.step(0.15)
    answers["unknown"] = client.restore("befor")
    answers["no_name"] = client.save("what is this")
    answers["again"] = client.save("later")
    client.step(0.02)
    client.reset(seed=9)  # checkpoints of a run before stay
    client.step(0.03)
    answers["from_reset"] = client.restore("later")
    client.step(0.04)
    return answers


def test_it_goes_back_and_its_status_is_that_of_the_checkpoint(used):
    _, answers = used
    saved = answers["saved"]
    assert (nanoseconds(saved.time), saved.names) == (153_456_700, ["before"])
    restored = answers["restored"]
    assert (restored.result.result, restored.time) == (Result.RESULT_OK, saved.time)
    status = answers["status"]
    assert (status.regime, status.weight_on_bit, status.state) == (
        "drilling",
        20.0,
        Status.STATE_PAUSED,
    )
    assert status.active_faults == 2


def test_a_request_that_cannot_be_is_refused_in_one_line(used):
    _, answers = used
    unknown = answers["unknown"]
    assert unknown.result.result == Result.RESULT_OPERATION_FAILED
    reason = "there is no checkpoint 'befor'; did you mean before?"
    assert unknown.result.error_message == reason
    assert "'what is this' is no name of a checkpoint" in answers["no_name"].result.error_message
    assert answers["again"].names == ["before", "later"]


def test_a_checkpoint_outlives_a_reset(used):
    _, answers = used
    assert nanoseconds(answers["from_reset"].time) == 303_456_700


def test_its_bag_is_proved(used):
    bag, _ = used
    verification = verify(bag)
    assert verification.proved, verification
    assert verification.warnings == ()
    for name, counts in verification.topics.items():
        # Latched ground truth may be overwritten before it is sent; all else arrives.
        assert counts.missing == 0 or name == "/rpud/faults"
    codec = installed_codec(TOPICS["journal"].type)
    with rpud_sim.bag.open(bag) as opened:
        kinds = [codec.decode(each.data).kind for each in opened.messages({"/rpud/journal"})]
    assert (kinds.count("save"), kinds.count("restore")) == (2, 2)
    assert (kinds.count("begin"), kinds[-1]) == (2, "end")


@pytest.mark.parametrize(("run", "at"), [(1, 0.1801), (2, 0.1534567), (4, 0.32)])
def test_each_of_its_runs_is_forked(used, tmp_path, run, at):
    """Runs 2 and 4 began at the checkpoints, run 3 at the reset."""
    bag, _ = used
    forked = write_fork(bag, tmp_path / "fork", at, run=run)
    assert forked.warnings == ()
    verification = verify(tmp_path / "fork")
    assert verification.proved, verification
    source = set(proved_messages(bag))
    own = proved_messages(tmp_path / "fork", skipped=1)
    # A run that a reset or a checkpoint ended ends by itself in its fork.
    others = [topic for topic, data in own if (topic, data) not in source]
    assert others == ["/rpud/journal"] * (run < 4)
    assert len(own) > 20
