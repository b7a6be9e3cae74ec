"""`rpud run`: the main job, whole, in processes of its own."""

import os
import re
import signal
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from drill_client import SECOND, TELEMETRY, stamps, steps
from rosbags.highlevel import AnyReader
from rpud_msgs.msg import Status
from support import called, rpud, until

import rpud_sim.bag


def run(*words):
    """Run `rpud run` to its end; give exit code, standard output and standard error."""
    done = rpud("run", *words)
    return done.returncode, done.stdout, done.stderr


def read(path):
    """Give the messages of a bag by topic, as rosbags reads them."""
    with AnyReader([path]) as reader:
        heard = {connection.topic: [] for connection in reader.connections}
        for connection, _, data in reader.messages():
            heard[connection.topic].append(reader.deserialize(data, connection.msgtype))
    return heard


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Two seconds of drilling, recorded."""
    path = tmp_path_factory.mktemp("session") / "bag"
    words = ("--duration", 2, "--record", path, "--max-loss", 0.25, "--set", "weight_on_bit=20")
    return path, run(*words)


@pytest.fixture(scope="module")
def heard(session):
    path, (code, _, errors) = session
    assert code == 0, errors
    return read(path)


def test_it_shows_rate_and_forces_and_ends_with_a_summary_and_the_bag(session):
    path, (code, output, errors) = session
    assert code == 0
    lines = output.splitlines()
    assert lines[0].startswith("recorded ")
    assert "drilled 2.00 s: " in output
    assert "impacts/s  peak force " in output
    end = r"deadlines? missed, 0 commands accepted, 0 rejected, 0 messages dropped"
    assert re.search(end, output)
    assert lines[-1] == f"bag: {path}"
    live = [line for line in errors.splitlines() if "reacting force" in line]
    assert live, errors
    assert " kN mean " in live[0]
    assert "Traceback" not in errors


def test_the_bag_has_every_sample_and_every_impact_from_the_first_on(heard):
    for topic in TELEMETRY:
        times = stamps(heard[f"/rpud/{topic}"])
        assert len(times) == 200, topic
        assert set(steps(times)) == {SECOND // 100}, topic
    impacts = heard["/rpud/contact_force"]
    assert [message.sequence for message in impacts] == list(range(len(impacts)))
    last = heard["/rpud/status"][-1]
    assert last.state == Status.STATE_STOPPED
    assert 0 <= last.impacts - len(impacts) <= 1
    assert last.weight_on_bit == 20.0


def test_a_bag_without_ros_has_the_topics_of_a_recording(session, capsys, tmp_path):
    """But for what only a node publishes: its states, timing, and results of commands."""

    def topics(path):
        with rpud_sim.bag.open(path) as bag:
            held = [summary for summary in bag.topics if summary.message_count]
        topics = {summary.topic: summary.definition for summary in held}
        of_node = ("/drill_node/", "/command_results", "/timing")
        return {it: topics[it] for it in topics if not any(word in it.name for word in of_node)}

    offline = tmp_path / "offline"
    assert called(capsys, "simulate", "--duration", 2, "--bag", offline)[0] == 0
    assert topics(offline) == topics(session[0])


def test_ctrl_c_ends_drill_and_recorder_and_the_bag_is_whole(process, tmp_path):
    path = tmp_path / "bag"
    running = process("rpud", "run", "--record", path)
    running.wait_for_line("reacting force")
    # The terminal sends it to the whole group, but the recorder must stop last.
    os.killpg(running.pid, signal.SIGINT)
    assert running.wait() == 0
    running.wait_for_line(f"^bag: {path}")
    heard = read(path)
    impacts = heard["/rpud/contact_force"]
    assert [message.sequence for message in impacts] == list(range(len(impacts)))
    assert heard["/rpud/status"][-1].state == Status.STATE_STOPPED


def recorder_of(running):
    """Give the process of a drill's recorder."""
    children = subprocess.run(
        ["ps", "-o", "pid=,args=", "--ppid", str(running.pid)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    [recorder] = [line.split()[0] for line in children.splitlines() if " record " in line]
    return recorder


@pytest.mark.extended
def test_a_killed_drill_leaves_a_whole_bag_and_no_recorder(process, tmp_path):
    path = tmp_path / "bag"
    running = process("rpud", "run", "--record", path)
    running.wait_for_line("reacting force")
    recorder = recorder_of(running)
    running.kill()
    until(lambda: not Path("/proc", recorder).exists() or has_ended(recorder))
    heard = read(path)
    impacts = heard["/rpud/contact_force"]
    assert len(impacts) > 100
    assert [message.sequence for message in impacts] == list(range(len(impacts)))


def has_ended(pid: str) -> bool:
    """Whether a child of another process has ended, even if its parent has not waited for it."""
    state, *fields = Path("/proc", pid, "stat").read_text().rpartition(")")[2].split()
    return state == "Z" and int(fields[16]) <= 1  # its other threads may outlive the first one


@pytest.mark.extended
@pytest.mark.parametrize(
    ("number", "complaint"),
    [
        (signal.SIGKILL, "rpud run: the recorder was ended by signal 9; its bag is truncated"),
        (signal.SIGTERM, "rpud run: the recorder was stopped before the drill"),
    ],
)
def test_a_recorder_that_ends_does_not_stop_the_drill_and_is_named_at_the_end(
    process, connect, tmp_path, number, complaint
):
    running = process("rpud", "run", "--record", tmp_path / "bag")
    running.wait_for_line("reacting force")
    recorder = recorder_of(running)
    os.kill(int(recorder), number)
    client = connect("/rpud")
    impacts = client.listen("contact_force")
    client.until(lambda: len(impacts) > 20 and has_ended(recorder))
    running.interrupt()
    assert running.wait() == 1
    assert complaint in running.output
    assert "drilled " in running.output
    assert "bag: " not in running.output


@pytest.mark.extended
def test_frames_and_joints_have_their_prefix_and_the_bag_is_proved(tmp_path, capsys):
    bag = tmp_path / "bag"
    on = ("feed_model=arm", "rotation_model=friction_drive", "publish_robot_description=true")
    words = [word for each in (*on, "frame_prefix=left_") for word in ("--set", each)]
    code, _, errors = run("--duration", 1, "--record", bag, *words)
    assert code == 0, errors
    heard = read(bag)
    described = heard.pop("/rpud/robot_description")
    frames = {
        message.header.frame_id
        for topic, messages in heard.items()
        if topic.startswith("/rpud/")
        for message in messages
        if hasattr(message, "header")
    }
    assert frames == {"left_rpud_mount", "left_rpud_nodal_plane", "left_rpud_tool_tip"}
    robot = ElementTree.fromstring(described[0].data)
    moving = {each.get("name") for each in robot.findall("joint") if each.get("type") != "fixed"}
    assert set(heard["/rpud/joint_states"][0].name) == moving
    assert "left_rpud_feed" in moving
    assert frames <= {each.get("name") for each in robot.findall("link")}
    assert called(capsys, "verify", bag)[0] == 0
