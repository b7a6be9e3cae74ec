"""Bags of runs without ROS, as of the drill node: of a new run, and of a fork."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpud_sim.bag import BagExistsError, BagWriter, QosProfile, Topic, whole_bag
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.losses import LOSSES_RECORD, Losses, losses_to_record
from rpud_sim.bag.manifest import MANIFEST_RECORD, Manifest, installed_versions, machine_name
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.fork import Continuation, Fork, open_fork
from rpud_sim.inspection.recorded_journal import installed_codec
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.plans import Agenda, Changes, Planned, apply_change
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.telemetry import Columns, Entry, Together
from rpud_sim.simulation.topics import TOPICS, DrillTopic, Fields, offered_topics

NAMESPACE = "/rpud"


def write_offline_bag(
    path: str | os.PathLike[str],
    beginning: Beginning,
    duration: float,
    scenario_text: str = "",
    report: Callable[[float], object] = lambda seconds: None,
    planned: Sequence[Planned] = (),
    topics: Collection[str] = tuple(TOPICS),
    manifest: Manifest | None = None,
) -> None:
    """Simulate a run for a duration [s] and write a bag of it, whose clock is simulation time.

    The bag holds what the drill node would publish, of ``topics`` as far as the drill offers them.
    ``planned`` is in the order of times. Its manifest is by default that of this program and
    machine.
    """
    offered = offered_topics(beginning.settings.values())
    chosen = {name: topic for name, topic in offered.items() if name in topics}
    run = Run(beginning, Journal(), chosen.__contains__)
    codecs = {name: installed_codec(topic.type) for name, topic in chosen.items()}
    values = {**beginning.settings.values(), "seed": beginning.seed}
    with _new_bag(
        path, f"{NAMESPACE}/", chosen, manifest or _manifest(values, scenario_text)
    ) as bag:
        for found in _messages(run, round(duration * SECOND), report, planned):
            if isinstance(found, Together):
                parts = encoded(found, codecs, f"{NAMESPACE}/")
                bag.write_blocks([(block, columns.places) for columns, block in parts])
            else:
                time, name, fields = found
                if name in codecs:
                    bag.write(f"{NAMESPACE}/{name}", codecs[name].encode(fields), time, time)


def _messages(
    run: Run, end: int, report: Callable[[float], object], planned: Sequence[Planned]
) -> Iterator[Entry | Together]:
    agenda = Agenda(each for each in planned if each.delay < end)
    run.begin(0)
    yield from run.changes()
    yield run.status("running", Bookkeeping())
    while run.time < end:
        before = run.time
        if agenda.next == before:
            for change in agenda.due(before):
                apply_change(run.control, change)
            yield from run.changes()
            yield run.status("running", Bookkeeping())
        yield from run.advance_together(min((before // SECOND + 1) * SECOND, agenda.next, end))
        report((run.time - before) / SECOND)
        if run.time % SECOND == 0:
            yield run.status("running", Bookkeeping())
    yield from run.flush("end")
    yield run.status("stopped", Bookkeeping())


def encoded(
    together: Together, codecs: Mapping[str, Codec], prefix: str
) -> Iterator[tuple[Columns, MessageBlock]]:
    """Yield the columns of each topic that has a codec, and its messages.

    ``codecs`` are by the names of topics in the run, ``prefix`` is of the names in a bag.
    """
    for columns in together.columns:
        if (codec := codecs.get(columns.topic)) is not None:
            data, sizes = codec.encoder.encode_columns(columns.fields, len(columns))
            starts, times = np.cumsum(sizes) - sizes, columns.times
            name = prefix + columns.topic
            yield columns, MessageBlock(name, times, times, data, starts, sizes)


@contextmanager
def _new_bag(
    path: str | os.PathLike[str],
    prefix: str,
    topics: Mapping[str, DrillTopic],
    manifest: Manifest,
) -> Iterator[BagWriter]:
    """Yield a bag with a drill's topics, of which it will lose no message."""
    with whole_bag(path) as bag:
        bag.add_record(MANIFEST_RECORD, manifest.to_record())
        for name, topic in topics.items():
            # The offers of the node's publishers, as a recorder discovers them.
            offer = QosProfile(durability="transient_local" if topic.latched else "volatile")
            bag.add_topic(
                Topic(f"{prefix}{name}", topic.type, find_type_hash(topic.type), (offer,)),
                find_definition(topic.type),
            )
        yield bag
        losses = {f"{prefix}{name}": Losses() for name in topics}
        bag.add_record(LOSSES_RECORD, losses_to_record(losses))


def _manifest(
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


@dataclass(frozen=True)
class ForkedBag:
    """Bag of a fork."""

    path: str  # of the bag
    source: str  # bag from which it forks
    run: int  # number of the run in it
    at: float  # instant of the fork, in simulation time of that run [s]
    duration: float  # simulated from there on [s]
    messages: int  # that were written, without those of the journal up to the instant
    changed: bool  # whether anything differs from the recorded run
    warnings: tuple[str, ...]  # one line each


def write_fork(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    at: float,
    duration: float | None = None,
    changes: Changes | None = None,
    *,
    run: int = 1,
    topic: str | None = None,
    report: Callable[[float], object] = lambda seconds: None,
) -> ForkedBag:
    """Go on from an instant of a recorded run, and write a bag of it.

    The recorded changes after the instant are repeated, unless ``changes`` replaces them. Without
    changes the bag holds the messages of the recorded one after the instant, bit for bit. It begins
    with the journal up to the instant, so that it can be verified and forked itself.

    Args:
        at: instant, in simulation time of the run [s].
        duration: to simulate from there on [s]; None up to the end of the recorded run.
        changes: from the instant on; None for none.
        run: number of the run, from 1; resets and restored checkpoints begin new ones.
        topic: of the journal, if the bag holds several.
    """
    changes = Changes() if changes is None else changes
    if os.path.lexists(out):
        raise BagExistsError(f"{os.fspath(out)} exists already; a bag is never overwritten")
    fork = open_fork(path, at, changes, run=run, topic=topic, stop=not changes.empty, report=report)
    continuation = Continuation(fork, changes, duration)
    first = list(continuation.begin())
    prefix = fork.recorded.prefix
    topics = offered_topics(fork.run.beginning.settings.values())
    values = {**fork.settings.values(), "seed": fork.run.beginning.seed}
    zero, published = _clock(fork)
    instant = zero + fork.time
    count = 0  # of messages after those of the instant
    with _new_bag(out, prefix, topics, _manifest(values, fork.scenario, fork.origin)) as bag:

        def write(name: str, fields: Fields, log_time: int, publish_time: int) -> None:
            data = installed_codec(topics[name].type).encode(fields)
            bag.write(f"{prefix}{name}", data, log_time, publish_time)

        # As a recorder that begins at the instant would get the latched topics.
        for (_, fields), publish_time in zip(fork.history, published, strict=True):
            write("journal", fields, instant, publish_time)
        for _, name, fields in (*fork.entries, *first):
            write(name, fields, instant, instant)
        between = fork.run.time < fork.time
        for time, name, fields in continuation.messages(report):
            # Without those of the block in which the instant lies, before it.
            if not between or time > fork.time:
                write(name, fields, zero + time, zero + time)
                count += 1
    return ForkedBag(
        os.fspath(out),
        os.fspath(path),
        run,
        fork.time / SECOND,
        (continuation.end - fork.time) / SECOND,
        count,
        not changes.empty,
        tuple(continuation.warnings),
    )


def _clock(fork: Fork) -> tuple[int, list[int]]:
    """Return the bag's clock at simulation time zero, and when the history was published [ns].

    Publishing times show which run a message belongs to: with runs before, every entry is before
    all that follows.
    """
    zero = max(0, fork.run.origin)
    count = len(fork.history) if fork.recorded.before else 0
    instant = max(zero + fork.time, count)
    return instant - fork.time, [
        min(publish_time, instant - max(0, count - place))
        for place, (publish_time, _) in enumerate(fork.history)
    ]
