"""A bag with faults that the tests of proofs alter."""

from sample_bags import write_offline_bag

from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario_file import parse_scenario

DURATION = 0.33
JOURNAL = "/rpud/journal"
ON_ARM = ("borehole", "mount", "rotation")
"""Proved topics that only a drill on an arm publishes."""

ARM = {
    "feed_model": "arm",
    "rotation_model": "friction_drive",
    "strata": "sandstone",
    "initial_feed": 0.005,
}
"""Parameters of a drill that rotates on an arm in a rock."""


def write_proof_bag(path):
    """Write the bag of a drill with faults of the physics and of topics."""
    scenario = parse_scenario(
        {
            "seed": 1,
            "faults": [
                {"kind": "lost_preload", "onset": 0.1, "duration": 0.15},
                {"kind": "noise", "channel": "wrench", "onset": 0.2},
                {"kind": "garbage", "channel": "reacting_force", "onset": 0.1, "duration": 0.1},
            ],
        },
        "scenario",
    )
    write_offline_bag(path, preset("drilling"), DURATION, 0.2, scenario, 11)
    return path
