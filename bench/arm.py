"""A drill on an arm in real time, beside the same node without its slow processes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from bench.row import Goal, Row, row
from bench.talk import Talk
from bench.telemetry import IN_TIME, ros

SECONDS = 60.0  # of listening to each node
WITHOUT = "without slow processes"
ARM: Mapping[str, object] = {
    "feed_model": "arm",
    "rotation_model": "friction_drive",
    # So hard that the hole does not get deeper: for all the time both nodes have the same 10 N.
    "strata": "'{layers: [{depth_from: 0.0, rock: basalt, specific_energy: 1.0e+12, "
    "threshold_energy: 1000.0}]}'",
    "initial_feed": 0.0055,
}
NODES: Mapping[str, Mapping[str, object]] = {WITHOUT: {}, "on an arm": ARM}
LATEST = Goal(most=5.0)  # [ms]


def arm(seconds: float = SECONDS) -> Iterator[Row]:
    """Run a node of each kind at default rates, one after the other, under a listener.

    Args:
        seconds: of listening to each node.
    """
    shares = {}
    with ros():
        for name, parameters in NODES.items():
            with Talk("drill_node", parameters) as talk:
                talk.settle()
                missed, blocks = talk.status().deadlines_missed, int(talk.diagnostics()["blocks"])
                counted = talk.measure(seconds)
                status, values = talk.status(), talk.diagnostics()
            shares[name] = 100.0 * counted.share
            yield row(f"arm, {name}: share of one core", [shares[name]], "%")
            for key in ("p50", "p99", "p99.9"):
                late = 1e3 * float(values[f"lateness_{key} [s]"])
                goal = LATEST if key == "p99.9" else None
                yield row(f"arm, {name}: lateness of blocks, {key}", [late], "ms", goal)
            passed = max(1, int(values["blocks"]) - blocks)
            in_time = 100.0 * (1.0 - (status.deadlines_missed - missed) / passed)
            yield row(f"arm, {name}: blocks within their period", [in_time], "%", IN_TIME)
            yield row(f"arm, {name}: simulated over real time", [status.real_time_factor])
    cost = shares["on an arm"] - shares[WITHOUT]
    yield row("arm: share of one core that the slow processes take", [cost], "%")
