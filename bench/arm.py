"""A drill on an arm in real time, side by side with the same node without its slow processes."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack

from bench.row import Row, row
from bench.talk import Talk
from bench.telemetry import RATIO, ros

SECONDS = 60.0  # of listening to both nodes
WITHOUT, WITH = "without slow processes", "on an arm"
ARM: Mapping[str, object] = {
    "feed_model": "arm",
    "rotation_model": "friction_drive",
    # So hard that the hole does not get deeper: for all the time both nodes have the same 10 N.
    "strata": "'{layers: [{depth_from: 0.0, rock: basalt, specific_energy: 1.0e+12, "
    "threshold_energy: 1000.0}]}'",
    "initial_feed": 0.0055,
}
NODES: Mapping[str, Mapping[str, object]] = {WITHOUT: {}, WITH: ARM}
_TURN = 0.05  # of listening to each node [s]


def arm(seconds: float = SECONDS) -> Iterator[Row]:
    """Run a node of each kind at default rates at the same time, each under a listener.

    What disturbs one of them disturbs the other, so their lateness can be compared.

    Args:
        seconds: of listening.
    """
    with ros(), ExitStack() as stack:
        talks = {name: stack.enter_context(Talk("drill_node", NODES[name])) for name in NODES}
        for talk in talks.values():
            talk.settle()
        for talk in talks.values():
            talk.reset()  # the start of the other took time from it
        used = {name: talk.processor_time() for name, talk in talks.items()}
        began = time.monotonic()
        while (elapsed := time.monotonic() - began) < seconds:
            for talk in talks.values():
                talk.listen(_TURN)
        shares = {
            name: 100.0 * (talk.processor_time() - used[name]) / elapsed
            for name, talk in talks.items()
        }
        values = {name: talk.diagnostics() for name, talk in talks.items()}
        factors = {name: talk.status().real_time_factor for name, talk in talks.items()}
    for name, found in values.items():
        yield row(f"arm, {name}: share of one core", [shares[name]], "%")
        for key in ("p50", "p99", "p99.9"):
            late = 1e3 * float(found[f"lateness_{key} [s]"])
            yield row(f"arm, {name}: lateness of blocks, {key}", [late], "ms")
        blocks, missed = int(found["blocks"]), int(found["deadlines_missed"])
        yield row(f"arm, {name}: blocks", [blocks])
        in_time = 100.0 * (1.0 - missed / blocks)
        yield row(f"arm, {name}: blocks within their period", [in_time], "%")
        yield row(f"arm, {name}: simulated over real time", [factors[name]])
    cost = shares[WITH] - shares[WITHOUT]
    yield row("arm: share of one core that the slow processes take", [cost], "%")
    for key in ("p50", "p99", "p99.9"):
        late, before = (float(values[name][f"lateness_{key} [s]"]) for name in (WITH, WITHOUT))
        goal = RATIO if key == "p99.9" else None
        what = f"arm: lateness of blocks over that {WITHOUT}, {key}"
        yield row(what, [late / before], "", goal)
