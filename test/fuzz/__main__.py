"""`make fuzz`: long campaigns against the drill and with bags, and tables of their results.

Exit 1 if something did harm.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from support import LOOPBACK
from tqdm import tqdm

from rpud_sim.testing.processes import DomainClaim


def main() -> int:
    """Have hostile bags read, and attack a drill of our own."""
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--bags", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    # Before there is a thread: its workers are forked.
    unharmed = _read_bags(arguments.bags, arguments.seed) if arguments.bags else True
    if arguments.inputs:
        unharmed &= _attack_drill(arguments.inputs, arguments.seed)
    return 0 if unharmed else 1


def _read_bags(bags: int, seed: int) -> bool:
    from fuzz import bag_campaign

    with tqdm(total=bags) as bar:
        outcome = bag_campaign.run(bags, seed, os.cpu_count() or 1, bar.update)
    bag_campaign.show(outcome)
    return not outcome.harms


def _attack_drill(inputs: int, seed: int) -> bool:
    claim = DomainClaim()
    os.environ.update(
        ROS_DOMAIN_ID=str(claim.domain),
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
        print(row("all", inputs, refused, accepted, ""))
        print(f"exceptions and changes by refused inputs: {len(outcome.harms)}")
        print(f"growth of memory after the first fifth: {outcome.growth / 1e6:.1f} MB")
        print(
            f"blocks {outcome.blocks}, deadlines missed {outcome.deadlines_missed}, "
            f"lag at the end {outcome.lag:g} s"
        )
        for harm in outcome.harms[:20]:
            print(f"harmed: {harm}", file=sys.stderr)

    with tempfile.TemporaryDirectory() as folder, tqdm(total=inputs) as bar:
        drill = Drill(Path(folder))
        try:
            outcome = run(drill, inputs, seed, bar.update)
        finally:
            drill.close()
    show(outcome)
    return outcome.unharmed


if __name__ == "__main__":
    sys.exit(main())
