"""The state of a run in its journal is whole: what goes on from it has the same bits."""

import json

import pytest

from rpud_sim.simulation.commands import Feed, WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.journal import Journal, JournalEntry
from rpud_sim.simulation.rerun import Rerun
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.state import state_of
from rpud_sim.simulation.telemetry import one_by_one

MILLISECOND = 1_000_000
DRILLS = {
    "drilling": {},
    "free": {"regime": "free"},
    "resonance": {"actuator_model": "resonance", "rock_model": "specific_energy"},
    "tracking": {"actuator_model": "resonance", "generator": "tracking"},
    "rotation": {"rotation_model": "friction_drive", "rock_model": "specific_energy"},
    "arm": {"feed_model": "arm", "strata": "regolith", "rotation_model": "friction_drive"},
}


def every_fault(run):
    """Inject each fault that the drill can have, on two channels where it acts on one."""
    for name, kind in KINDS.items():
        for channel in ("",) if kind.physical else ("wrench", "contact_force"):
            try:
                run.simulation.inject(Fault(name, channel), 400 * MILLISECOND)
            except FaultError:
                continue


@pytest.mark.parametrize("faulty", [False, True])
@pytest.mark.parametrize("name", DRILLS)
def test_a_run_goes_on_from_its_state_with_the_same_bits(name, faulty):
    run = Run(Beginning.drawn(to_settings(DRILLS[name])), Journal())
    run.begin(5)
    entries = [each for each in run.advance_to(330 * MILLISECOND) if each[1] == "journal"]
    if faulty:
        every_fault(run)
    run.control.apply(Feed("rate", 1e-4) if name == "arm" else WeightOnBit(11.0))
    entries += [each for each in run.advance_to(371 * MILLISECOND) if each[1] == "journal"]
    run.note_state()
    last = [each for each in run.changes() if each[1] == "journal"]
    own = to_entry(last[-1])
    text = json.dumps(state_of(run), sort_keys=True)

    began = Rerun()
    assert list(began.repeat(own)) == []
    assert json.dumps(state_of(began.run), sort_keys=True) == text
    repeated = Rerun()
    for entry in (*entries, *last):
        for _ in repeated.repeat(to_entry(entry)):
            pass
    assert json.dumps(state_of(repeated.run), sort_keys=True) == text

    end = 900 * MILLISECOND
    expected = repr([each for each in run.advance_to(end) if each[1] != "journal"])
    assert repr(list(one_by_one(began.advance_to(end)))) == expected


def to_entry(message):
    """Return the entry of a message as a bag's reader has it."""
    _, _, fields = message
    content = json.loads(fields["content"])
    return JournalEntry(fields["sequence"], content.pop("time"), fields["kind"], content)
