"""A small specification of a data set, for tests."""

from rpud_sim.studies.dataset.specification_file import parse_specification

CONTENT = {
    "duration": 4.0,
    "settling": 0.5,
    "onset": {"minimum": 1.0, "maximum": 2.0},
    "lasting": {"minimum": 0.5, "maximum": 1.0},
    "fixed": {"rock_model": "specific_energy"},
    "rocks": {
        "chalk": {"split": "train", "rock_specific_energy": 1e7},
        "sandstone": {"split": "validation", "rock_specific_energy": 75e6},
        "basalt": {"split": "test", "rock_specific_energy": 2e8},
    },
    "faults": [
        {"kind": "choking", "severities": [0.2, 0.9]},
        {"kind": "off", "channel": "wrench"},
    ],
}


def parsed(**entries):
    return parse_specification(CONTENT | entries)
