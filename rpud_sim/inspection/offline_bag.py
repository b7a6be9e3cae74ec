"""Bag of a run without ROS: the topics of the drill node, in simulation time from zero."""

from __future__ import annotations

import os
import sys
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence

from rpud_sim.bag import BagWriter, QosProfile, Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.losses import LOSSES_RECORD, Losses, losses_to_record
from rpud_sim.bag.manifest import MANIFEST_RECORD, Manifest, installed_versions, machine_name
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.encoded import encoded
from rpud_sim.simulation.changes import Planned, apply_change
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.together import Entry, Together
from rpud_sim.simulation.topics import TOPICS, offered_topics

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
    encoders = {
        name: Codec(topic.type, find_definition(topic.type)).encoder
        for name, topic in chosen.items()
    }
    manifest = manifest or Manifest(
        parameters={**beginning.settings.values(), "seed": beginning.seed},
        scenario=scenario_text,
        command=tuple(sys.argv),
        versions=installed_versions(),
        machine=machine_name(),
    )
    with BagWriter(path) as bag:
        bag.add_record(MANIFEST_RECORD, manifest.to_record())
        for name, topic in chosen.items():
            # The offers of the node's publishers, as a recorder discovers them.
            offer = QosProfile(durability="transient_local" if topic.latched else "volatile")
            bag.add_topic(
                Topic(f"{NAMESPACE}/{name}", topic.type, find_type_hash(topic.type), (offer,)),
                find_definition(topic.type),
            )
        for found in _messages(run, round(duration * SECOND), report, planned):
            if isinstance(found, Together):
                bag.write_blocks(encoded(found, encoders, f"{NAMESPACE}/"))
            else:
                time, name, values = found
                if name in encoders:
                    bag.write(f"{NAMESPACE}/{name}", encoders[name].encode(values), time, time)
        losses = {f"{NAMESPACE}/{name}": Losses() for name in chosen}
        bag.add_record(LOSSES_RECORD, losses_to_record(losses))


def _messages(
    run: Run, end: int, report: Callable[[float], object], planned: Sequence[Planned]
) -> Iterator[Entry | Together]:
    pending = deque(each for each in planned if each.delay < end)
    run.begin(0)
    yield from run.changes()
    yield run.status("running", Bookkeeping())
    while run.time < end:
        before = run.time
        if pending and pending[0].delay == before:
            while pending and pending[0].delay == before:
                apply_change(run, pending.popleft().change)
            yield from run.changes()
            yield run.status("running", Bookkeeping())
        until = pending[0].delay if pending else end
        yield from run.advance_together(min((before // SECOND + 1) * SECOND, until, end))
        report((run.time - before) / SECOND)
        if run.time % SECOND == 0:
            yield run.status("running", Bookkeeping())
    yield from run.flush("end")
    yield run.status("stopped", Bookkeeping())
