"""Bags of runs without ROS, as for the drill node: of a new run, and of a fork."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from rpud_sim.bag import BagWriter, QosProfile, Topic, whole_bag
from rpud_sim.bag.metadata import LOSSES_RECORD, Losses, losses_to_record
from rpud_sim.bag.own_records import MANIFEST_RECORD, Manifest, installed_versions, machine_name
from rpud_sim.foundation.options import NAMESPACE
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Batch, groups
from rpud_sim.messages.definitions import find_definition, find_type_hash, installed_codec
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.changes import SetOrigin
from rpud_sim.simulation.plan import Journal, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.topics import TOPICS, DrillTopic, offered_topics

_REPORTED = {"power", "status"}


def write_offline_bag(
    path: str | os.PathLike[str],
    plan: Plan,
    duration: float,
    scenario_text: str = "",
    report: Callable[[float], object] = lambda seconds: None,
    topics: Collection[str] = tuple(TOPICS),
    on_block: Callable[[Block], object] = lambda block: None,
) -> None:
    """Simulate a run for a duration [s] and write a bag of it, whose clock is simulation time.

    The bag holds what the drill node would publish, of ``topics`` as far as the drill offers them.
    Its manifest names this program and machine. ``on_block`` is as of ``Run``.
    """
    values = plan.beginning.settings.values()
    chosen = {n: topic for n, topic in kept_topics(values).items() if n in topics}
    manifest = new_manifest(values, scenario_text)
    with drill_bag(path, f"{NAMESPACE}/", chosen, manifest) as writer:
        for batches in run_batches(plan, round(duration * SECOND), chosen, report, on_block):
            writer.write(batches)


def kept_topics(parameters: Mapping[str, Any]) -> dict[str, DrillTopic]:
    """Return the topics of a drill that a bag of a run without ROS has, by name."""
    return {name: topic for name, topic in offered_topics(parameters).items() if not topic.live}


def run_batches(
    plan: Plan,
    end: int,
    topics: Collection[str],
    report: Callable[[float], object] = lambda seconds: None,
    on_block: Callable[[Block], object] = lambda block: None,
) -> Iterator[Iterable[Batch]]:
    """Yield all batches of a run that ends at a time [ns], each part in the order of writing."""
    # Its stamps are simulation time, also where a recorded run had other stamps.
    again = [change for change in plan.changes if not isinstance(change.action, SetOrigin)]
    again = [change for change in again if change.time < end]
    plan = replace(plan, changes=tuple(again))
    reports = not _REPORTED.isdisjoint(topics)  # which a run without them need not compute
    run = Run(plan, Journal(), topics.__contains__, reports=reports, on_block=on_block)
    run.begin(0)
    yield run.changes()
    yield run.reports()
    yield reported(run, end, report)
    yield run.flush(ends=True)
    yield run.reports("stopped")


def reported(run: Run, end: int, report: Callable[[float], object]) -> Iterator[Batch]:
    """Advance a run to a time [ns], and report the simulated seconds since the last call."""
    while True:  # what is due at the current time comes also where the run ends
        before = run.time
        yield from run.advance_to(min(end, (before // SECOND + 1) * SECOND))
        report((run.time - before) / SECOND)
        if run.time >= end:
            return


class BatchWriter:
    """Writer of a run's batches into a bag, of topics by their names in the run."""

    def __init__(self, bag: BagWriter, prefix: str, topics: Collection[str]) -> None:
        self.count = 0  # messages so far
        self._bag = bag
        self._prefix = prefix
        self._codecs = {name: installed_codec(TOPICS[name].type) for name in topics}

    def write(self, batches: Iterable[Batch], zero: int = 0, received: int | None = None) -> None:
        """Write batches; ``zero`` is the bag's time at simulation time zero [ns].

        They are received when they are published, or at ``received`` [ns].
        """
        for together in groups(each for each in batches if each.topic in self._codecs):
            found = []
            for batch in together:
                times = batch.publish_times + zero
                received_at = times if received is None else np.full(len(batch), received)
                found.append(
                    replace(
                        batch.serialized(self._codecs[batch.topic]),
                        topic=self._prefix + batch.topic,
                        publish_times=times,
                        log_times=received_at,
                    )
                )
                self.count += len(batch)
            self._bag.write_batches(found)


@contextmanager
def drill_bag(
    path: str | os.PathLike[str],
    prefix: str,
    topics: Mapping[str, DrillTopic],
    manifest: Manifest,
) -> Iterator[BatchWriter]:
    """Yield a writer of a new bag with a drill's topics, of which it will lose no message."""
    with whole_bag(path) as bag:
        bag.add_record(MANIFEST_RECORD, manifest.to_record())
        for name, topic in topics.items():
            # The offers of the node's publishers, as a recorder discovers them.
            offer = QosProfile(durability="transient_local" if topic.latched else "volatile")
            bag.add_topic(
                Topic(f"{prefix}{name}", topic.type, find_type_hash(topic.type), (offer,)),
                find_definition(topic.type),
            )
        yield BatchWriter(bag, prefix, topics)
        losses = {f"{prefix}{name}": Losses() for name in topics}
        bag.add_record(LOSSES_RECORD, losses_to_record(losses))


def new_manifest(
    parameters: Mapping[str, Any], scenario: str | None, origin: Mapping[str, Any] | None = None
) -> Manifest:
    """Return the manifest of a bag that this program writes on this machine."""
    return Manifest(
        parameters=parameters,
        scenario=scenario,
        command=tuple(sys.argv),
        versions=installed_versions(),
        machine=machine_name(),
        forked_from=origin or {},
    )
