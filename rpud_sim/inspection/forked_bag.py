"""Bag of a fork: the journal up to its instant, and the messages after it."""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Callable

from rpud_sim.bag import BagExistsError, BagWriter, QosProfile, Topic
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.losses import LOSSES_RECORD, Losses, losses_to_record
from rpud_sim.bag.manifest import MANIFEST_RECORD, Manifest, installed_versions, machine_name
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.continuation import Continuation
from rpud_sim.inspection.fork import Fork, open_fork
from rpud_sim.inspection.verify.installed_types import installed_codec
from rpud_sim.simulation.changes import Changes
from rpud_sim.simulation.fields import Fields
from rpud_sim.simulation.together import Entry
from rpud_sim.simulation.topics import offered_topics


@dataclasses.dataclass(frozen=True)
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
    written = _write(out, fork, continuation, first, report)
    return ForkedBag(
        os.fspath(out),
        os.fspath(path),
        run,
        fork.time / SECOND,
        (continuation.end - fork.time) / SECOND,
        written,
        not changes.empty,
        tuple(continuation.warnings),
    )


def _write(
    out: str | os.PathLike[str],
    fork: Fork,
    continuation: Continuation,
    first: list[Entry],
    report: Callable[[float], object],
) -> int:
    """Write the bag; return the number of messages after the history."""
    prefix = fork.recorded.prefix
    topics = offered_topics(fork.resumed.run.beginning.settings.values())
    codecs = {name: installed_codec(topic.type) for name, topic in topics.items()}
    zero, published = _clock(fork)
    instant = zero + fork.time
    count = 0
    with BagWriter(out) as bag:
        bag.add_record(MANIFEST_RECORD, _manifest(fork).to_record())
        for name, topic in topics.items():
            # The offers of the node's publishers, as a recorder discovers them.
            offer = QosProfile(durability="transient_local" if topic.latched else "volatile")
            bag.add_topic(
                Topic(f"{prefix}{name}", topic.type, find_type_hash(topic.type), (offer,)),
                find_definition(topic.type),
            )

        def write(name: str, fields: Fields, log_time: int, publish_time: int) -> None:
            bag.write(f"{prefix}{name}", codecs[name].encode(fields), log_time, publish_time)

        # As a recorder that begins at the instant would get the latched topics.
        for (_, fields), publish_time in zip(fork.history, published, strict=True):
            write("journal", fields, instant, publish_time)
        faults = fork.resumed.faults
        for _, name, fields in (*((faults,) if faults else ()), *fork.resumed.entries, *first):
            write(name, fields, instant, instant)
        between = fork.resumed.run.time < fork.time
        for time, name, fields in continuation.messages(report):
            if between and time <= fork.time:  # of the block in which the instant lies, before it
                continue
            write(name, fields, zero + time, zero + time)
            count += 1
        losses = {f"{prefix}{name}": Losses() for name in topics}
        bag.add_record(LOSSES_RECORD, losses_to_record(losses))
    return count


def _clock(fork: Fork) -> tuple[int, list[int]]:
    """Return the bag's clock at simulation time zero, and when the history was published [ns].

    Publishing times show which run a message belongs to: with runs before, every entry is before
    all that follows.
    """
    zero = max(0, fork.resumed.run.origin)
    count = len(fork.history) if fork.recorded.before else 0
    zero += max(0, count - zero - fork.time)
    instant = zero + fork.time
    return zero, [
        min(publish_time, instant - max(0, count - place))
        for place, (publish_time, _) in enumerate(fork.history)
    ]


def _manifest(fork: Fork) -> Manifest:
    beginning = fork.resumed.run.beginning
    return Manifest(
        parameters={**fork.resumed.settings.values(), "seed": beginning.seed},
        scenario=fork.scenario,
        command=tuple(sys.argv),
        versions=installed_versions(),
        machine=machine_name(),
        forked_from=fork.origin,
    )
