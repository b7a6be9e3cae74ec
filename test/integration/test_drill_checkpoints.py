"""A drill goes back to a checkpoint: what follows is the same again, and its bag proves it."""

import pytest
from drill_client import Client, contents, end, nanoseconds, stamps
from rpud_msgs.msg import Drive, Result, Status, WeightOnBit
from sample_bags import PLAIN_PROVED, proved_messages
from support import Process

import rpud_sim.bag
from rpud_sim.inspection.offline_bag import write_fork
from rpud_sim.inspection.recorded_journal import installed_codec
from rpud_sim.inspection.verify.verification import verify
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
MILLISECOND = 1_000_000


def command(client, message, field, value):
    client.command(message)
    client.until(lambda: client.status and getattr(client.status[-1], field) == value)


@pytest.fixture(scope="module")
def used(start_module_drill, tmp_path_factory):
    """Record a drill that goes back twice; return the bag and what a client heard."""
    folder = tmp_path_factory.mktemp("checkpoints")
    drill = start_module_drill("/rpud", **OPTIONS)
    with Process("rpud", "record", "--out", folder / "bag") as recorder, Client() as client:
        for topic in PLAIN_PROVED:
            recorder.wait_for_line(f"subscribed /rpud/{topic} ")
        heard = use(client)
        end(drill, recorder)
    return folder / "bag", heard


def use(client):
    runs = {topic: client.listen_to_runs(topic) for topic in ("wrench", "contact_force")}
    client.until(lambda: all(client.node.count_publishers(f"/rpud/{topic}") for topic in runs))
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
    # The second checkpoint is later than the reset run, so that its stamps go on in one list.
    client.until(lambda: all(len(each) == 3 for each in runs.values()))
    client.until(lambda: stamps(runs["wrench"][2][-1:])[0] >= 340 * MILLISECOND)
    return answers, runs


def test_it_goes_back_and_the_same_follows_bit_for_bit(used):
    _, (answers, runs) = used
    saved = nanoseconds(answers["saved"].time)
    assert saved == 153_456_700
    assert answers["saved"].names == ["before"]
    assert answers["restored"].result.result == Result.RESULT_OK
    assert nanoseconds(answers["restored"].time) == saved
    for topic, period in (("wrench", 10), ("contact_force", 0)):
        first = [m for m in runs[topic][0] if saved < stamps([m])[0] <= saved + 149 * MILLISECOND]
        again = [m for m in runs[topic][1] if stamps([m])[0] <= saved + 149 * MILLISECOND]
        assert len(first) >= (149 // period - 1 if period else 20)
        assert list(map(contents, first)) == list(map(contents, again[-len(first) :])), topic


def test_its_status_is_that_of_the_checkpoint(used):
    _, (answers, _) = used
    status = answers["status"]
    assert (status.regime, status.weight_on_bit, status.state) == (
        "drilling",
        20.0,
        Status.STATE_PAUSED,
    )
    assert status.active_faults == 2


def test_a_request_that_cannot_be_is_refused_in_one_line(used):
    _, (answers, _) = used
    unknown = answers["unknown"]
    assert unknown.result.result == Result.RESULT_OPERATION_FAILED
    reason = "there is no checkpoint 'befor'; did you mean before?"
    assert unknown.result.error_message == reason
    assert "'what is this' is no name of a checkpoint" in answers["no_name"].result.error_message
    assert answers["again"].names == ["before", "later"]


def test_a_checkpoint_outlives_a_reset(used):
    _, (answers, _) = used
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


@pytest.mark.parametrize(("run", "at"), [(1, 0.1801), (2, 0.1534567), (3, 0.0111), (4, 0.32)])
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
