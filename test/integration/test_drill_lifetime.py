"""A drill begins, is stopped, is disturbed, and loses those around it; the others go on."""

import os
import signal

import pytest
from drill_client import SECOND, nanoseconds, stamps, steps
from rpud_msgs.msg import Status


def test_a_signal_ends_it_cleanly_and_the_end_is_published(start_drill, connect):
    node = start_drill("/ending")
    client = connect("/ending")
    statuses, impacts = client.status, client.listen("contact_force")
    waveforms = client.listen("waveform")
    client.until(lambda: statuses and len(impacts) > 10 and waveforms)
    assert statuses[-1].state == Status.STATE_RUNNING
    node.interrupt()
    client.until(lambda: statuses[-1].state == Status.STATE_STOPPED)
    assert node.wait() == 0
    assert "Traceback" not in node.output
    last = statuses[-1]
    # What happened until the end is heard as well,
    end = nanoseconds(last.header.stamp)
    # but for an impact whose contact has not ended.
    client.until(lambda: last.impacts - 1 <= impacts[-1].sequence + 1)

    def told():
        final = waveforms[-1]
        period = round(final.sample_period * SECOND)
        return stamps([final])[0] + len(final.reacting_force) * period

    client.until(lambda: told() >= end)
    assert told() == end
    assert set(steps([message.sequence for message in impacts])) == {1}


def test_a_drill_ends_with_its_parent_where_that_is_wanted(process, connect):
    shell = process("sh", "-c", "drill_node --with-parent --ros-args -r __ns:=/orphaned & wait")
    shell.wait_for_line("drilling: regime")
    client = connect("/orphaned")
    client.until(lambda: client.status)
    shell.kill()
    shell.wait_for_line("parent process exited; shutting down")
    client.until(lambda: client.status[-1].state == Status.STATE_STOPPED)


@pytest.mark.extended
def test_neither_a_frozen_nor_a_killed_listener_nor_a_killed_recorder_holds_it_up(
    start_drill, process, connect, tmp_path
):
    node = start_drill("/rpud")
    words = ("rpud", "echo", "contact_force", "--field", "sequence")
    frozen, killed = (process(*words) for _ in range(2))
    recorder = process("recorder", "--out", tmp_path / "run")
    for listener in (frozen, killed):
        listener.wait_for_line("^---$")
    recorder.wait_for_line(r"recording \d+ topics")
    client = connect("/rpud")
    statuses, impacts = client.status, client.listen("contact_force")
    timings = client.listen("timing")
    client.until(lambda: statuses and impacts and timings)
    os.kill(frozen.pid, signal.SIGSTOP)
    killed.kill()
    recorder.kill()
    heard = stamps(statuses[-1:])[0]
    # In time, or in time again on a busy machine.
    client.until(lambda: stamps(statuses[-1:])[0] >= heard + 3 * SECOND and timings[-1].lag < 0.1)
    assert set(steps([message.sequence for message in impacts])) == {1}
    assert timings[-1].messages_dropped == 0
    # Nor do those that never acknowledge hold up its end.
    node.interrupt()
    assert node.wait(30.0) == 0
    os.kill(frozen.pid, signal.SIGCONT)
