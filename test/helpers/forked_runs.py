"""Recorded runs that tests fork and verify, and what they read of a bag."""

import hashlib
import itertools

import numpy as np

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.own_records import MANIFEST_RECORD, manifest_from_record
from rpud_sim.messages.batch import rows_of
from rpud_sim.messages.definitions import find_definition, find_type_hash, installed_codec
from rpud_sim.simulation.changes import Clear, Configure, Inject, SetOrigin
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.plan import Beginning, Journal, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.scenario_file import parse_scenario
from rpud_sim.simulation.topics import TOPICS

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
START = 1_700_000_000 * SECOND + 123
JOURNAL = "/rpud/journal"
STATUS = "/rpud/status"
FAULTS = parse_scenario(
    {
        "seed": 4,
        "faults": [
            {"kind": "lost_preload", "onset": 0.0312345, "duration": 0.05},
            {"kind": "delayed", "channel": "contact_force", "onset": 0.02, "magnitude": 0.013},
            {"kind": "noise", "channel": "wrench", "onset": {"uniform": [0.0, 0.1]}},
            {"kind": "garbage", "channel": "drill_tool", "onset": 0.06, "duration": 0.03},
        ],
    },
    "scenario",
)
PROVED_FAULTS = parse_scenario(
    {
        "seed": 1,
        "faults": [
            {"kind": "lost_preload", "onset": 0.1, "duration": 0.15},
            {"kind": "noise", "channel": "wrench", "onset": 0.2},
            {"kind": "garbage", "channel": "reacting_force", "onset": 0.1, "duration": 0.1},
        ],
    },
    "scenario",
)
# Proved topics that only a drill on an arm publishes, and its parameters.
ON_ARM = ("borehole", "mount", "rotation")
ARM = {
    "feed_model": "arm",
    "rotation_model": "friction_drive",
    "strata": "sandstone",
    "initial_feed": 0.005,
}
VALUES = {
    "prescribed": {"regime": "drilling"},
    "resonance": {
        "actuator_model": "resonance",
        "generator": "tracking",
        "rock_model": "specific_energy",
        "telemetry_rate": 130,
        "block_duration": 0.03,
    },
}


class Used:
    """Bag of a drill to which everything happened, and all that it published."""

    def __init__(self, path, values):
        random = np.random.default_rng(3)
        self.path = path
        self.published = write_used(path, values, lambda number: random.random() < 0.1)


def digest(data):
    """Return a short text for a message, which a failing test can show."""
    return hashlib.sha256(data).hexdigest()[:16]


def use(values):
    """Yield the messages of a drill to which everything happens: number of the run, and each."""
    journal = Journal()
    settings = to_settings({**values, "command_timeout": 0.04, "command_loss_ramp": 0.02})
    run = Run(Plan(Beginning(settings, 0.3, 5, FAULTS)), journal)

    def advance(milliseconds):
        end = run.time + round(milliseconds * MILLISECOND)
        while run.time < end:
            yield from run.advance_to(min(run.next_boundary, end))
            run.watch()

    def first():
        run.begin(START)
        run.take_over()
        yield from advance(33.3)
        run.apply(WeightOnBit(25.0))
        yield from advance(20)
        run.apply(Inject(Fault("bias", "nodal_plane", 1e-5), 30 * MILLISECOND))
        yield from run.changes()
        run.apply(Inject(Fault("stuck", "reacting_force")))
        run.apply(Drive(True, 80.0, 16_050.0))
        yield from advance(7.7777)
        run.apply(Clear(run.simulation.faults.active[0].number))
        run.activate(False)
        yield from advance(9)
        run.activate(True)
        yield from advance(70)  # the commands are lost, and go down to nothing
        run.apply(Configure({"actuator_restitution": 0.8, "regime": "free"}))
        yield from run.flush()
        run.apply(SetOrigin(START + 7))  # a reset of the time alone
        yield from advance(31.4)
        yield from run.flush()

    def second():
        run.begin(START + SECOND)
        run.take_over()
        yield from advance(41)
        run.apply(WeightOnBit(5.0))
        run.apply(Configure({"real_time_factor": 2.0}))  # no parameter of the drill
        yield from advance(30)
        yield from run.flush(ends=True)

    yield from ((1, row) for row in rows_of(first()))
    run = Run(Plan(Beginning(settings, 0.7, 6)), journal)
    yield from ((2, row) for row in rows_of(second()))


def write_used(path, values, lost=lambda number: False):
    """Write such a drill's bag, without those messages that got lost; return all messages."""
    codecs = {name: installed_codec(topic.type) for name, topic in TOPICS.items()}
    published = []
    numbers = itertools.count()
    with BagWriter(path) as bag:
        for name, topic in TOPICS.items():
            bag.add_topic(
                Topic(f"/rpud/{name}", topic.type, find_type_hash(topic.type)),
                find_definition(topic.type),
            )
        for run, (time, name, fields) in use(values):
            data = codecs[name].encode(fields)
            published.append((run, time, f"/rpud/{name}", digest(data)))
            if name == "journal" or not lost(next(numbers)):
                log_time = START + run * SECOND + time
                bag.write(f"/rpud/{name}", data, log_time + 5000, log_time)
    return published


def held(path, topics=None):
    with rpud_sim.bag.open(path) as bag:
        return [(m.log_time, m.topic, digest(m.data)) for m in bag.messages(topics)]


def decoded(path, name):
    """Return the messages of one topic."""
    codec = installed_codec(TOPICS[name].type)
    with rpud_sim.bag.open(path) as bag:
        return [codec.decode(message.data) for message in bag.messages({f"/rpud/{name}"})]


def entries_of(path):
    return decoded(path, "journal")


def manifest_of(path):
    with rpud_sim.bag.open(path) as bag:
        return manifest_from_record(bag.records(MANIFEST_RECORD)[0])
