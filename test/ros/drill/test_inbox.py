"""Commands wait in order; those refused are counted in full and logged in part."""

import threading
import time

from rpud_msgs.msg import CommandResult
from std_msgs.msg import Header

from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.simulation.commands import WeightOnBit

GIVEN = CommandResult(kind="weight_on_bit")


class Log:
    def __init__(self):
        self.lines = []

    def warning(self, line):
        self.lines.append(line)


def test_the_delay_of_a_command_runs_from_its_arrival_until_it_is_drained():
    inbox = Inbox(Log())
    inbox.accept(WeightOnBit(1.0), GIVEN, time.monotonic_ns() - 70_000_000)
    inbox.accept(WeightOnBit(2.0), GIVEN)
    assert inbox.take_delays().count == 0
    inbox.drain()
    delays = inbox.take_delays()
    assert delays.count == 2
    assert delays.greatest >= 0.07
    after = inbox.take_delays()
    assert (after.count, after.greatest) == (0, 0.0)


def test_a_refusal_of_a_command_or_a_request_is_counted_and_logged_with_its_reason():
    log = Log()
    inbox = Inbox(log)
    inbox.refuse(GIVEN, "weight_on_bit = -1 N is outside its range [0, 1000] N")
    inbox.refuse_request("there is no fault 7 to clear")
    assert inbox.drain() == []
    assert (inbox.accepted, inbox.rejected, inbox.requests_refused) == (0, 1, 1)
    assert inbox.last_refusal == "there is no fault 7 to clear"
    assert log.lines == [
        "command refused: weight_on_bit = -1 N is outside its range [0, 1000] N",
        "request refused: there is no fault 7 to clear",
    ]


def test_a_flood_is_counted_in_full_and_logged_in_part():
    log = Log()
    inbox = Inbox(log)
    for number in range(10_000):
        inbox.refuse(GIVEN, str(number))
    assert inbox.rejected == 10_000
    # Ten lines and a note for each second, and the flood may span two.
    assert 11 <= len(log.lines) <= 22
    assert log.lines[0] == "command refused: 0"
    assert "more is refused in this second, and counted" in log.lines


def test_whoever_takes_is_woken_by_every_command_and_every_refusal():
    woken = []
    inbox = Inbox(Log(), lambda: woken.append(True))
    inbox.accept(WeightOnBit(1.0), GIVEN)
    inbox.refuse(GIVEN, "for a reason")
    assert len(woken) == 2


def test_a_new_beginning_forgets_what_waits_and_what_was_counted():
    inbox = Inbox(Log())
    inbox.accept(WeightOnBit(1.0), GIVEN)
    inbox.drain()
    inbox.refuse(GIVEN, "for a reason")
    inbox.accept(WeightOnBit(2.0), GIVEN)
    inbox.begin()
    assert inbox.drain() == []
    assert (inbox.accepted, inbox.rejected) == (0, 0)


def test_each_result_is_told_once_after_the_last_ones_of_each_kind():
    inbox = Inbox(Log())
    assert inbox.take_results() is None
    first, second, third = (
        CommandResult(kind="weight_on_bit", header=Header(frame_id=name))
        for name in ("first", "second", "third")
    )
    refused = CommandResult(kind="drive")
    inbox.accept(WeightOnBit(1.0), first)
    assert inbox.take_results() is None  # it waits
    inbox.drain()
    assert inbox.take_results() == ([], [first])
    assert (first.accepted, first.reason) == (True, "")
    inbox.accept(WeightOnBit(2.0), second)
    inbox.refuse(refused, "for a reason")
    inbox.drain()
    assert inbox.take_results() == ([first], [refused, second])
    assert (refused.accepted, refused.reason) == (False, "for a reason")
    inbox.accept(WeightOnBit(3.0), third)
    inbox.begin()
    former, [discarded] = inbox.take_results()
    assert (former, discarded, discarded.accepted) == ([], third, False)
    assert "began again" in discarded.reason


def test_nothing_is_lost_between_two_threads():
    inbox = Inbox(Log())
    forces = [WeightOnBit(number / 100) for number in range(20_000)]

    def fill():
        for force in forces:
            inbox.accept(force, GIVEN)

    filler = threading.Thread(target=fill)
    filler.start()
    taken = []
    while filler.is_alive() or len(taken) < len(forces):
        taken += inbox.drain()
    filler.join()
    assert taken == forces  # once each, in the order in which they came
    assert inbox.drain() == []
    assert (inbox.accepted, inbox.rejected) == (len(forces), 0)
