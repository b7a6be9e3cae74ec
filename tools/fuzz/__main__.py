"""`make fuzz`: long campaigns against the drill and with bags, and tables of their results.

Exit 1 if something did harm.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from tqdm import tqdm

from rpud_sim.testing.processes import DomainClaim
from tools import LOOPBACK
from tools.fuzz import bag_campaign
from tools.fuzz.tally import Outcome


def main() -> int:
    """Have hostile bags read, and attack a drill of our own."""
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--bags", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    outcomes = []
    if arguments.bags:  # before there is a thread: its workers are forked
        with tqdm(total=arguments.bags) as bar:
            workers = os.cpu_count() or 1
            found = bag_campaign.run(arguments.bags, arguments.seed, workers, bar.update)
        outcomes.append(found)
    if arguments.inputs:
        outcomes.append(_attack_drill(arguments.inputs, arguments.seed))
    for outcome in outcomes:
        outcome.show()
    return 1 if any(outcome.harms for outcome in outcomes) else 0


def _attack_drill(inputs: int, seed: int) -> Outcome:
    claim = DomainClaim()
    os.environ.update(
        ROS_DOMAIN_ID=str(claim.domain),
        ROS_PYTHON_CHECK_FIELDS="1",  # our own messages are well-formed, as those that DDS brings
        **LOOPBACK,
    )
    from tools.fuzz.campaign import run
    from tools.fuzz.drill import Drill

    with tempfile.TemporaryDirectory() as folder, tqdm(total=inputs) as bar:
        drill = Drill(Path(folder))
        try:
            return run(drill, inputs, seed, bar.update)
        finally:
            drill.close()


if __name__ == "__main__":
    sys.exit(main())
