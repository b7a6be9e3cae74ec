"""Card of a data set: its README, with the names by which loaders find the splits."""

from __future__ import annotations

from collections.abc import Sequence

from rpud_sim.simulation.faults import KINDS
from rpud_sim.simulation.versions import PHYSICS, version_of
from rpud_sim.studies.dataset import NOTICE
from rpud_sim.studies.dataset.plan import PlannedRun
from rpud_sim.studies.dataset.specification import HEALTHY, SPLITS, Specification

_BODY = """\
# Faults of a rotary-percussive ultrasonic drill

> **{notice}**

{runs} runs of {duration:g} s, made by rpud_sim {version} (physics {physics}) with seed {seed}. The
same specification and seed give the same bytes with the same versions on a machine of one kind.

## Splits

A rock is in one split only, so that a test shows what a detector makes of a rock that it never met.

{splits}

## Faults

{faults}

## Files

- `runs/SPLIT.parquet`: a row for each run: rock, kind, channel, severity, magnitude with unit,
  onset and clear [s], exact as `onset_ns` and `clear_ns`, seed, `bag`, and `failure` if the run
  could not go on.
- `windows/SPLIT.parquet`: a row for each window of {length:g} s, one every {stride:g} s: features
  of all topics, and labels.
- `TOPIC/SPLIT.parquet`: a row for each message, with labels. Topics: {topics}.
- `bags/SPLIT/RUN`: the run as an MCAP bag. `rpud verify` proves each of its messages. The topics
  `faults` and `journal` hold its ground truth.
- `dataset.json`: specification, seed, versions, and the SHA-256 of each file.

## Labels

- `label` is the kind of the fault that lasts, `{healthy}` without one. A fault lasts from its onset
  on and ends before its clear; without a clear it lasts to the end of the run.
- A sample has the label of its stamp. A window has the label of a fault that lasts for any part of
  it, and `share` is that part.
- `severity` counts the magnitudes of a kind from 1, in the order of the specification.
- A feature of a window without messages is NaN. A window has the messages that were published in
  it: a late message counts when it comes.
- Units and descriptions are metadata of the columns.
"""


def make_card(specification: Specification, runs: Sequence[PlannedRun]) -> str:
    """Return the text of the card, with the configurations that loaders of data sets read."""
    tables = ("windows", "runs", *specification.topics)
    head = ["---", "pretty_name: Faults of a rotary-percussive ultrasonic drill (synthetic)"]
    head += ["tags: [synthetic, simulation, time-series, fault-detection]", "configs:"]
    for table in tables:
        head += [f"- config_name: {table}", "  data_files:"]
        for split in SPLITS:
            head += [f"  - split: {split}", f"    path: {table}/{split}.parquet"]
    splits = ["| split | rocks | runs | of them healthy |", "|---|---|---|---|"]
    for split in SPLITS:
        own = [run for run in runs if run.split == split]
        rocks = ", ".join(dict.fromkeys(run.rock for run in own))
        splits.append(
            f"| {split} | {rocks} | {len(own)} | {sum(run.fault is None for run in own)} |"
        )
    faults = ["| kind | channel | magnitudes by severity | meaning |", "|---|---|---|---|"]
    for series in specification.faults:
        quantity = KINDS[series.kind].quantity_on(series.channel)
        magnitudes = ", ".join(f"{magnitude:g}" for magnitude in series.magnitudes)
        shown = f"{magnitudes} {quantity.unit}".rstrip() if quantity else "none"
        meaning = KINDS[series.kind].description
        meaning += f"; magnitude: {quantity.description}" if quantity else ""
        faults.append(f"| `{series.kind}` | {series.channel or 'none'} | {shown} | {meaning} |")
    body = _BODY.format(
        notice=NOTICE,
        runs=len(runs),
        duration=specification.duration,
        version=version_of("rpud_sim"),
        physics=PHYSICS,
        seed=specification.seed,
        splits="\n".join(splits),
        faults="\n".join(faults),
        length=specification.window.length,
        stride=specification.window.stride,
        topics=", ".join(f"`{topic}`" for topic in specification.topics),
        healthy=HEALTHY,
    )
    return "\n".join([*head, "---", "", body])
