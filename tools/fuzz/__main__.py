"""`make fuzz`: hostile bags and inputs, and tables of their results; exit 1 if one did harm."""

from __future__ import annotations

import argparse
import os
import sys

from tqdm import tqdm

from rpud_sim.testing.processes import DomainClaim
from tools import LOOPBACK
from tools.fuzz import bags


def main() -> int:
    """Have hostile bags read, and attack a drill of our own; `--only` repeats one input."""
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--bags", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, metavar="N", help="number of the only bag and input")
    arguments = parser.parse_args()

    def numbers(count: int) -> tqdm:
        chosen = range(count) if arguments.only is None else [arguments.only][:count]
        return tqdm(chosen, disable=None)

    outcomes = []
    if arguments.bags:  # before there is a thread: its workers are forked
        outcomes.append(bags.run(numbers(arguments.bags), arguments.seed, os.cpu_count() or 1))
    if arguments.inputs:
        claim = DomainClaim()
        os.environ.update(ROS_DOMAIN_ID=str(claim.domain), ROS_PYTHON_CHECK_FIELDS="1", **LOOPBACK)
        from tools.fuzz import drill

        outcomes.append(drill.run(numbers(arguments.inputs), arguments.seed))
    for outcome in outcomes:
        outcome.show()
    return int(any(outcome.harms for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
