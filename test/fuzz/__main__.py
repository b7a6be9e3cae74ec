"""`make fuzz`: a long campaign, and a table of what came of it. Exit 1 if it harmed the drill."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from support import LOOPBACK, claim_ros_domain
from tqdm import tqdm


def main() -> int:
    """Attack a drill of our own."""
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    domain, _lock = claim_ros_domain()
    os.environ.update(
        ROS_DOMAIN_ID=str(domain),
        ROS_PYTHON_CHECK_FIELDS="1",  # our own messages are well-formed, as those that DDS brings
        **LOOPBACK,
    )
    from fuzz.campaign import Outcome, run
    from fuzz.drill import Drill

    def show(outcome: Outcome) -> None:
        row = "{:28} {:>8} {:>8} {:>8} {:>14}".format
        print(row("way", "inputs", "refused", "accepted", "slowest [ms]"))
        for way, tally in outcome.tallies.items():
            slowest = f"{1e3 * tally.slowest:.1f}"
            print(row(way, tally.inputs, tally.refused, tally.accepted, slowest))
        refused = sum(tally.refused for tally in outcome.tallies.values())
        accepted = sum(tally.accepted for tally in outcome.tallies.values())
        print(row("all", arguments.inputs, refused, accepted, ""))
        print(f"exceptions and changes by refused inputs: {len(outcome.harms)}")
        print(f"growth of memory after the first fifth: {outcome.growth / 1e6:.1f} MB")
        print(
            f"blocks {outcome.blocks}, deadlines missed {outcome.deadlines_missed}, "
            f"lag at the end {outcome.lag:g} s"
        )
        for harm in outcome.harms[:20]:
            print(f"harmed: {harm}", file=sys.stderr)

    with tempfile.TemporaryDirectory() as folder, tqdm(total=arguments.inputs) as bar:
        drill = Drill(Path(folder))
        try:
            outcome = run(drill, arguments.inputs, arguments.seed, bar.update)
        finally:
            drill.close()
    show(outcome)
    return 0 if outcome.unharmed else 1


if __name__ == "__main__":
    sys.exit(main())
