"""Labelled bags for a fault detector: `python examples/labelled_faults.py FOLDER`.

Each rock is drilled once without a fault and once with each. `labels.csv` has the truth: a message
has the fault if its stamp is from `onset` on and before `clear` [s]. All of it is synthetic: a
detector that finds these faults may not find faults of a real drill. Test it on another rock than
the rocks that it has learned from.
"""

import csv
import sys
from pathlib import Path

import rpud_sim

ROCKS = {
    "chalk": {"rock_specific_energy": 1.0e7, "drill_tool_restitution": 0.45},
    "limestone": {"rock_specific_energy": 6.0e7, "drill_tool_restitution": 0.55},
    "sandstone": {"rock_specific_energy": 7.5e7, "drill_tool_restitution": 0.60},
    "basalt": {"rock_specific_energy": 2.0e8, "drill_tool_restitution": 0.65},
}
FAULTS = (
    {"kind": "free_mass_jammed"},
    {"kind": "lost_preload", "magnitude": 0.8},
    {"kind": "choking", "magnitude": {"uniform": [0.3, 0.8]}},
    {"kind": "restitution_loss", "magnitude": 0.4},
    {"kind": "stuck", "channel": "reacting_force"},
    {"kind": "bias", "channel": "wrench", "magnitude": {"uniform": [0.5, 5.0]}},
)
LABELS = ("bag", "rock", "seed", "kind", "channel", "magnitude", "onset", "clear")


def seconds(stamp):
    return round(stamp["sec"] + 1e-9 * stamp["nanosec"], 9)


def main(folder, duration=6.0):
    # The seed of a run draws its phase, its noise, and onset and duration of its fault.
    drawn = {"onset": (0.4, 0.6), "duration": (0.2, 0.3)}
    times = {name: {"uniform": [duration * s for s in each]} for name, each in drawn.items()}
    cases = [(rock, fault) for rock in ROCKS for fault in (None, *FAULTS)]
    folder.mkdir(parents=True)
    with open(folder / "labels.csv", "w", newline="") as file:
        labels = csv.DictWriter(file, LABELS, restval="", extrasaction="ignore")
        labels.writeheader()
        for seed, (rock, fault) in enumerate(cases, 1):
            faults = [{**fault, **times}] if fault else None
            drill = {"rock_model": "specific_energy", "sample_rate": 1000, **ROCKS[rock]}
            run = rpud_sim.simulate(duration, seed=seed, faults=faults, **drill)
            name = f"{seed:03}-{rock}-{fault['kind'] if fault else 'healthy'}"
            run.save(folder / name)
            truth = [each for listed in run["faults"]["faults"][-1:] for each in listed]
            own = {key: value for each in truth for key, value in each.items()}
            own |= {key: seconds(own[key]) for key in ("onset", "clear") if truth}
            labels.writerow({**own, "bag": name, "rock": rock, "seed": seed})
    print(f"{len(cases)} bags and {folder / 'labels.csv'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
