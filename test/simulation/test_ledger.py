"""The ledger of faults is the ground truth: exact times, nothing twice, nothing lost."""

import pytest

from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.ledger import MOST_CLEARED, FaultLedger, FaultRecord

OFF = Fault("off", "wrench")
JAM = Fault("free_mass_jammed")


def test_faults_are_numbered_from_one_and_keep_their_times():
    faults = FaultLedger()
    assert (faults.inject(10, OFF), faults.inject(20, JAM)) == (1, 2)
    assert faults.clear(30, 1) == FaultRecord(1, OFF, 10, 30)
    assert faults.active == (FaultRecord(2, JAM, 20),)
    assert faults.inject(40, OFF) == 3
    assert [(record.number, record.onset, record.clear) for record in faults.records] == [
        (1, 10, 30),
        (2, 20, None),
        (3, 40, None),
    ]


def test_what_lasts_is_the_same_object_until_something_changes():
    faults = FaultLedger()
    assert faults.active == ()
    faults.inject(0, OFF)
    assert faults.active is faults.active is faults.since(5)


def test_the_same_kind_on_the_same_channel_is_there_once():
    faults = FaultLedger()
    faults.inject(0, OFF)
    faults.inject(0, Fault("off", "drill_tool"))
    faults.inject(0, Fault("noise", "wrench"))
    with pytest.raises(FaultError, match=r"^off on wrench is already there as fault 1$"):
        faults.inject(5, Fault("off", "wrench"))
    assert faults.inject(5, JAM) == 4  # the refused one took no number


@pytest.mark.parametrize("number", [0, 2, -1, None, "1", 10**400])
def test_what_does_not_last_cannot_end(number):
    faults = FaultLedger()
    faults.inject(0, OFF)
    with pytest.raises(FaultError, match=r"^there is no fault .* to clear$"):
        faults.clear(5, number)
    faults.clear(5, 1)
    with pytest.raises(FaultError, match=r"^there is no fault 1 to clear$"):
        faults.clear(6, 1)


def test_a_fault_lasts_from_its_onset_to_before_its_end():
    record = FaultRecord(1, OFF, 10, 20)
    assert [record.lasts_at(time) for time in (9, 10, 19, 20)] == [False, True, True, False]
    assert FaultRecord(1, OFF, 10).lasts_at(10**18)


def test_a_block_sees_the_faults_that_ended_in_it():
    faults = FaultLedger()
    faults.inject(10, OFF)
    faults.inject(11, JAM)
    faults.clear(20, 1)
    assert [record.number for record in faults.since(19)] == [1, 2]
    assert [record.number for record in faults.since(20)] == [2]


def test_of_many_cleared_faults_the_oldest_are_only_counted():
    faults = FaultLedger()
    lasting = faults.inject(0, JAM)
    for time in range(MOST_CLEARED + 5):
        faults.clear(time, faults.inject(time, OFF))
    assert faults.forgotten == 5
    numbers = [record.number for record in faults.records]
    assert numbers == [lasting, *range(7, MOST_CLEARED + 7)]
