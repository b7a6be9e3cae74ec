"""Random expectations and records, for Hypothesis."""

from hypothesis import strategies as st

from rpud_sim import bag as bags
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import SECOND
from rpud_sim.verdicts import Record
from rpud_sim.verdicts import formulas as f

# Signals with units and thresholds that a drill of Table 2 crosses.
NUMBERS = {
    "reacting_force.force": [(5.0, "N"), (10.0, "N"), (0.03, "kN"), (0.0, "")],
    "wrench.wrench.force.z": [(-9000.0, "mN"), (0.0, "N")],
    "nodal_plane.velocity": [(0.0, "m/s"), (1.0, "mm/min")],
    "contact_force.peak_force": [(1.0, "kN"), (5000.0, "N"), (9.5, "kN")],
    "contact_force.sequence": [(3.0, ""), (40.0, "")],
    "status.weight_on_bit": [(10.0, "N"), (0.0, "N")],
    "status.impacts": [(0.0, ""), (30.0, ""), (100.0, "%")],
    "status.weight_on_bit_applied": [(0.0, "s")],
}
WORDS = [
    ("status.state", "running"),
    ("status.state", "stopped"),
    ("drill_tool.in_contact", True),
    ("drill_tool.in_contact", False),
    ("journal.kind", "inject"),
]
FAULTS = ["free_mass_jammed", "bias on reacting_force", "off on contact_force", "hard_rock"]
TOPICS = ("contact_force", "drill_tool", "faults", "journal", "nodal_plane")
TOPICS += ("reacting_force", "status", "wrench")
OPERATORS = ["<", "<=", ">", ">=", "==", "!="]


def messages_of(path, topics):
    """Return topic, stamp and message of all messages, as a subscriber has them."""
    with bags.open(path) as reader:
        wanted = {f"/rpud/{topic}": topic for topic in topics}
        codecs = {
            each.topic.name: Codec(each.topic.type, each.definition)
            for each in reader.topics
            if each.topic.name in wanted
        }
        found = []
        for message in reader.messages(list(wanted)):
            decoded = codecs[message.topic].decode(message.data)
            stamp = decoded.header.stamp.sec * SECOND + decoded.header.stamp.nanosec
            found.append((message.topic, stamp, decoded))
    return found


class RandomFormulas:
    """Source of random formulas over the topics of a drill.

    Args:
        random: as ``random.Random``.
    """

    def __init__(self, random):
        self.random = random
        self.atoms = (
            self.compare,
            self.says,
            self.active,
            self.event,
            self.count,
            self.quantile,
        )

    def formula(self, depth=3):
        """Return any formula."""
        if depth == 0 or self.random.random() < 0.3:
            return self.random.choice(self.atoms)()
        one = self.formula(depth - 1)
        kind = self.random.randrange(9)
        if kind in (0, 1):
            return (f.Always, f.Eventually)[kind](one, self.window())
        if kind == 2:
            return f.Not(one)
        other = self.formula(depth - 1)
        if kind in (3, 4):
            return (f.And, f.Or)[kind - 3]((one, other))
        if kind == 5:
            return f.Implies(one, other)
        if kind == 6:
            return f.Until(one, other, self.window())
        if kind == 7:
            return f.Until(one, other, f.WHOLE, True)
        return f.After(self.event() if self.random.random() < 0.7 else one, other)

    def compare(self):
        """Return a comparison."""
        name = self.random.choice(sorted(NUMBERS))
        value, unit = self.random.choice(NUMBERS[name])
        operator = self.random.choice(OPERATORS)
        tolerance = f.Number(0.0)
        if operator in ("==", "!=") and value and self.random.random() < 0.5:
            tolerance = f.Number(abs(value) / 4, unit)
        return f.Compare(self.signal(name), operator, f.Number(value, unit), tolerance)

    def says(self):
        """Return a word."""
        name, word = self.random.choice(WORDS)
        return f.Says(self.signal(name), word)

    def active(self):
        """Return a fault."""
        return f.Active(self.random.choice(FAULTS))

    def event(self):
        """Return an event."""
        kind = self.random.randrange(5)
        if kind < 2:
            return (f.Onset, f.Cleared)[kind](self.random.choice(FAULTS))
        if kind == 2:
            return f.Published(self.random.choice(["contact_force", "journal", "status"]))
        where = self.random.choice([self.compare, self.says])()
        if kind == 3:
            return f.Becomes(where)
        return f.Published(where.signal.topic, where)

    def count(self):
        """Return a comparison of a count."""
        number = float(self.random.choice([0, 1, 2, 40, 500]))
        return f.Count(self.event(), self.random.choice(OPERATORS), number, self.window())

    def quantile(self):
        """Return a comparison of a quantile."""
        each, share = self.compare(), self.random.choice([0.01, 0.5, 0.9, 0.99, 1.0])
        signal = f.Signal(each.signal.topic, each.signal.field)
        return f.Quantile(share, signal, each.operator, each.number, self.window())

    def signal(self, name):
        """Return a signal of a name."""
        hold = self.random.choice([None, None, None, SECOND // 50])
        return f.Signal(*name.split(".", 1), hold)

    def window(self):
        """Return a window."""
        first, second = sorted(self.random.randrange(1200) * SECOND // 1000 for _ in range(2))
        return self.random.choice([f.WHOLE, f.Window(0, second), f.Window(first, second)])


def formulas():
    """Return the strategy of all formulas."""
    return st.randoms().map(lambda random: RandomFormulas(random).formula())


def record_of(**signals):
    """Return a record of reacting_force, nodal_plane and status from {stamp: value} of each."""
    fields = {
        "force": ("reacting_force", "force"),
        "velocity": ("nodal_plane", "velocity"),
        "weight": ("status", "weight_on_bit"),
    }
    record = Record()
    for name, samples in signals.items():
        topic, field = fields[name]
        for stamp, value in samples.items():
            record.add(topic, stamp, {field: value})
    return record
