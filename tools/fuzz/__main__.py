"""`make fuzz`: hostile bags and inputs, and tables of their results; exit 1 if one did harm."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable

from tqdm import tqdm

from rpud_sim.testing.processes import DomainClaim
from tools import LOOPBACK
from tools.fuzz import Outcome, bags


def main() -> int:
    """Have hostile bags read, and attack a drill of our own; `--only` repeats one input."""
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--bags", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, metavar="N", help="number of the only bag and input")
    arguments = parser.parse_args()
    seed, harms = arguments.seed, 0

    def numbers(count: int) -> tqdm:
        chosen = range(count) if arguments.only is None else [arguments.only][:count]
        return tqdm(chosen, disable=None)

    if arguments.bags:  # before there is a thread: its workers are forked
        harms += _show("bag", seed, bags.run(numbers(arguments.bags), seed))
    if arguments.inputs:
        claim = DomainClaim()
        os.environ.update(ROS_DOMAIN_ID=str(claim.domain), ROS_PYTHON_CHECK_FIELDS="1", **LOOPBACK)
        from tools.fuzz import drill

        harms += _show("input", seed, drill.run(numbers(arguments.inputs), seed))
    return int(harms > 0)


def _show(what: str, seed: int, outcomes: Iterable[Outcome]) -> int:
    """Print a table by way, and the first harms of each; return their number."""
    rows, harms = dict[str, tuple[int, int, float, float]](), list[Outcome]()
    for each in outcomes:
        inputs, refused, slowest, largest = rows.get(each.way, (0, 0, 0.0, 0.0))
        most = max(slowest, each.seconds), max(largest, each.memory)
        rows[each.way] = inputs + 1, refused + each.refused, *most
        harms += [each] * bool(each.harms)
    print(f"{'way':28} {'inputs':>8} {'refused':>8} {'slowest [ms]':>14} {'most [MB]':>12}")
    for way, (inputs, refused, slowest, largest) in sorted(rows.items()):
        print(f"{way:28} {inputs:8} {refused:8} {1e3 * slowest:14.1f} {largest:12.0f}")
    print(f"harms: {len(harms)}", flush=True)
    for way in rows:
        for each in [harm for harm in harms if harm.way == way][:5]:
            text = "\n".join(each.harms)
            print(f"harmed: {what} {each.number} of seed {seed}, {way}: {text}", file=sys.stderr)
    return len(harms)


if __name__ == "__main__":
    sys.exit(main())
