"""Changes of a forked run: at its exact instant, and against the recorded changes that follow."""

import json

import pytest
from inspection.forked_runs import JOURNAL, MILLISECOND, decoded, entries_of, held, manifest_of
from rpud_sim.recorded.verify.verification import verify
from rpud_sim.simulation.plans import parameter_changes

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.recorded.offline_bag import write_fork
from rpud_sim.simulation.scenario_file import parse_injections, read_commands


def test_a_change_acts_exactly_at_the_instant(plain, tmp_path):
    changes = parameter_changes(
        {"weight_on_bit": 40.0, "drive_enabled": False, "regime": "free"}
    ) + parse_injections(["bias,channel=wrench,magnitude=5,duration=0.01"])
    write_fork(plain, tmp_path / "fork", 0.1234567, 0.2, changes)
    entries = entries_of(tmp_path / "fork")
    assert [e.sequence for e in entries] == list(range(len(entries)))
    made = [e for e in entries if json.loads(e.content)["time"] == 123_456_700]
    assert [e.kind for e in made] == ["stop", "configure", "weight_on_bit", "drive", "inject"]
    assert json.loads(made[2].content)["force"] == 40.0
    times = [t for t, topic, _ in held(tmp_path / "fork") if topic != JOURNAL]
    assert (min(times), max(times)) == (123_456_700, 323_456_700)


def test_a_change_changes_what_follows(plain, tmp_path):
    write_fork(plain, tmp_path / "fork", 0.1, 0.2, parameter_changes({"weight_on_bit": 30.0}))
    own = held(tmp_path / "fork", {"/rpud/nodal_plane"})
    source = [each for each in held(plain, {"/rpud/nodal_plane"}) if each[0] > 100 * MILLISECOND]
    assert [t for t, _, _ in own] == [t for t, _, _ in source]
    assert all(one[2] != other[2] for one, other in zip(own, source, strict=True))


def commanded(entries, after):
    """Return times and kinds of the commands after a time [ns]."""
    found = ((json.loads(e.content)["time"], e.kind) for e in entries)
    return [each for each in found if each[0] > after and each[1] in ("weight_on_bit", "drive")]


def test_own_commands_replace_the_recorded_ones(used, tmp_path):
    (tmp_path / "commands.yaml").write_text(
        "commands:\n"
        "  - {time: 0.0055, weight_on_bit: 12}\n"
        "  - {time: 0.02, drive: {enabled: false}}\n"
        "  - {time: 0.03, drive: {voltage: 70}}\n"
        "faults:\n"
        "  - {kind: hard_rock, onset: 0.01, duration: 0.01}\n"
    )
    changes = read_commands(tmp_path / "commands.yaml")
    forked = write_fork(used.path, tmp_path / "fork", 0.02, 0.07, changes)
    found = commanded(entries_of(tmp_path / "fork"), 20 * MILLISECOND)
    assert found == [(25_500_000, "weight_on_bit"), (40_000_000, "drive"), (50_000_000, "drive")]
    with_rock = "rock_model" in manifest_of(tmp_path / "fork").parameters
    assert with_rock
    refused = [w for w in forked.warnings if "hard_rock" in w]
    assert all(w.startswith("refused at 0.03 s: ") for w in refused)
    assert verify(tmp_path / "fork").proved


def test_the_watchdog_watches_over_own_commands(used, tmp_path):
    """40 ms after the last command of the file they are lost, and go down within 20 ms."""
    (tmp_path / "commands.yaml").write_text("commands: [{time: 0.01, weight_on_bit: 12}]")
    changes = read_commands(tmp_path / "commands.yaml")
    write_fork(used.path, tmp_path / "fork", 0.01, 0.1, changes)
    entries = entries_of(tmp_path / "fork")
    times = [time for time, kind in commanded(entries, 20 * MILLISECOND) if kind == "drive"]
    assert times[0] >= 60 * MILLISECOND
    assert (
        json.loads(next(e for e in reversed(entries) if e.kind == "drive").content)["enabled"]
        is False
    )
    assert verify(tmp_path / "fork").proved


def test_a_value_that_is_set_stays_when_the_recorded_run_changes_others(used, tmp_path):
    changes = parameter_changes({"actuator_restitution": 0.55})
    write_fork(used.path, tmp_path / "fork", 0.05, None, changes)
    recorded = [e for e in entries_of(tmp_path / "fork") if e.kind == "configure"]
    values = [json.loads(e.content)["parameters"] for e in recorded]
    assert [v["actuator_restitution"] for v in values] == [0.55, 0.55]
    assert [v["regime"] for v in values] == ["drilling", "free"]


def test_a_recorded_clear_finds_its_fault_under_another_number(used, tmp_path):
    forked = write_fork(
        used.path, tmp_path / "fork", 0.0001, 0.07, parse_injections(["lost_preload"])
    )
    # The scenario begins the same fault later, which a node would refuse as well.
    assert not any("clear" in warning for warning in forked.warnings)
    last = decoded(tmp_path / "fork", "faults")[-1]
    kinds = {fault.kind for fault in last.faults if not fault.active}
    clears = [e for e in entries_of(tmp_path / "fork") if e.kind == "clear"]
    assert len(clears) == 1
    assert kinds


def test_a_change_at_the_instant_that_is_refused_leaves_no_bag(plain, tmp_path):
    with pytest.raises(ParameterError, match="resonance_drift cannot be honoured"):
        write_fork(plain, tmp_path / "fork", 0.1, None, parse_injections(["resonance_drift"]))
    with pytest.raises(ParameterError, match="weight_on_bit = -1 N is outside"):
        write_fork(plain, tmp_path / "fork", 0.1, None, parameter_changes({"weight_on_bit": -1}))
    assert not (tmp_path / "fork").exists()


def test_a_later_one_is_refused_as_a_node_would(plain, tmp_path):
    (tmp_path / "f.yaml").write_text("faults: [{kind: noise, channel: wrench, onset: 0.1}]")
    forked = write_fork(plain, tmp_path / "fork", 0.15, None, read_commands(tmp_path / "f.yaml"))
    assert forked.warnings == (
        "refused at 0.25 s: noise on wrench is already there as fault "
        + forked.warnings[0].rpartition(" ")[2],
    )
    assert verify(tmp_path / "fork").proved
