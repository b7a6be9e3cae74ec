"""Digests of all messages and figures of some drills, to compare processes: `python same_bits.py`.

The argument shortens all drills by this factor. With `--keep` in its place, the digests become
those of the engine version, in `data/bits.json`.
"""

import hashlib
import json
import sys
import tempfile
from pathlib import Path

from silent_drill import plans_of

import rpud_sim.bag
from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation.changes import Change, Inject
from rpud_sim.simulation.commands import Drive, Feed, MountMotion, WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.ensemble import run_members
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.plan import Beginning, Plan, initial_phases
from rpud_sim.simulation.versions import ENGINE

KEPT = Path(__file__).parents[1] / "data" / "bits.json"
MILLISECOND = 1_000_000
ROCK = {"rock_model": "specific_energy"}
RESONANCE = {"actuator_model": "resonance", "generator": "tracking", "heating": True}
ARM = {
    "feed_model": "arm",
    "rotation_model": "friction_drive",
    "strata": "{layers: [{depth_from: 0.0, rock: regolith}, {depth_from: 0.00002, rock: chalk}]}",
    "initial_feed": 0.004,
}
AGILE = {**ARM, "feed_rate_limit": 0.04, "arm_play": 2e-4}
DRILLS = {  # parameters, and simulated time [ms]
    "free": ({"regime": "free"}, 100),
    "drilling": ({}, 200),
    "stiff": ({"contact_model": "printed", "drill_tool_restitution": 0.9}, 100),
    "resonance": ({**RESONANCE, **ROCK}, 200),
    "strata": ({"strata": "sandstone"}, 200),
    "arm": (ARM, 200),
    "faults": ({**RESONANCE, **ARM}, 200),
    "arm before drilling": ({**AGILE, "regime": "free", "initial_feed": 0.01}, 200),
    "slipping arm": ({**AGILE, "anchoring_force": 6.0}, 200),
    "rigid arm": ({**AGILE, "arm_stiffness": 0.0, "bit_wear_rate": 1e-6}, 300),
    "given mount": ({**AGILE, "feed_model": "given"}, 200),
    "rotor": ({"rotation_model": "friction_drive", "rotor_stall_torque": 0.02, **ROCK}, 200),
}
FAULTS = {
    "faults": (
        Fault("noise", "reacting_force"),
        Fault("noise", "contact_force"),
        Fault("garbage", "contact_force"),
        Fault("garbage", "drill_tool"),
        Fault("intermittent", "wrench", 0.5),
        Fault("delayed", "nodal_plane", 0.01),
        Fault("binding"),
        Fault("resonance_drift"),
        Fault("lost_preload", magnitude=0.4),
    ),
    "rigid arm": (
        Fault("worn_bit"),
        Fault("hard_inclusion"),
        Fault("corkscrewing", magnitude=0.005),
        Fault("bit_walk"),
        Fault("choking"),
        Fault("hard_rock"),
        Fault("drill_tool_binding"),
        Fault("arm_slip"),
        Fault("load_spring_binding"),
        Fault("restitution_loss"),
    ),
    "slipping arm": (Fault("feed_stall"), Fault("free_mass_jammed")),
}


def beginning(name: str) -> Beginning:
    settings = to_settings(DRILLS[name][0])
    faults = tuple(
        Change((10 + number) * MILLISECOND, Inject(fault, 90 * MILLISECOND))
        for number, fault in enumerate(FAULTS.get(name, ()))
    )
    return Beginning(settings, 0.2, 3, faults)


def commands(name: str) -> tuple[Change, ...]:
    values, _ = DRILLS[name]
    if "feed_model" not in values:
        return (Change(5 * MILLISECOND, WeightOnBit(12.0)),)
    if values["feed_model"] == "given":
        motions = (MountMotion(0.0041, 0.03), MountMotion(0.006, -0.02, 6 * MILLISECOND))
        return tuple(Change(5 * n * MILLISECOND, each) for n, each in enumerate(motions, 1))
    planned = [Change(5 * MILLISECOND, Feed("rate", 0.004))]
    if "feed_rate_limit" in values:
        planned += [
            Change(140 * MILLISECOND, Feed("rate", -0.03)),
            Change(160 * MILLISECOND, Drive(False, 100.0, 16000.0)),
            Change(170 * MILLISECOND, Feed("position", 0.006)),
            Change(180 * MILLISECOND, Drive(True, 70.0, 16000.0)),
        ]
    return tuple(planned)


def digests(bag: Path) -> dict[str, str]:
    found = {}
    with rpud_sim.bag.open(bag) as opened:
        for message in opened.messages():
            if not message.topic.endswith("/journal"):  # it names the machine
                digest = found.setdefault(message.topic, hashlib.sha256())
                digest.update(message.data + message.log_time.to_bytes(8, "little"))
    return {topic: digest.hexdigest()[:16] for topic, digest in sorted(found.items())}


def all_digests(shorter: float, folder: Path) -> dict[str, dict[str, str]]:
    """Digests of each topic of each drill, and of its figures; bags go into the folder."""
    found = {}
    for name, (_, length) in DRILLS.items():
        duration = length / 1000.0 / shorter
        write_offline_bag(folder / name, Plan(beginning(name), commands(name)), duration)
        found[name] = digests(folder / name)
        configuration = to_settings(DRILLS[name][0]).configuration
        members = run_members(plans_of(configuration, initial_phases(2, 1)), duration)
        figures = json.dumps([member.metrics.to_dict() for member in members])
        found[name]["figures"] = hashlib.sha256(figures.encode()).hexdigest()[:16]
    return found


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        if sys.argv[1] == "--keep":
            kept = {"engine": ENGINE, **all_digests(1.0, Path(scratch))}
            KEPT.write_text(json.dumps(kept, indent=1) + "\n")
        else:
            print(json.dumps(all_digests(float(sys.argv[1]), Path(scratch))))
