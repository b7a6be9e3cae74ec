"""Random expectations and records, for Hypothesis."""

from hypothesis import strategies as st

from rpud_sim import bag as bags
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.cdr import Codec
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


@st.composite
def comparisons(draw):
    name = draw(st.sampled_from(sorted(NUMBERS)))
    number = f.Number(*draw(st.sampled_from(NUMBERS[name])))
    operator = draw(st.sampled_from(f.OPERATORS))
    tolerance = f.Number(0.0)
    if operator in ("==", "!=") and number.value and draw(st.booleans()):
        tolerance = f.Number(abs(number.value) / 4, number.unit)
    return f.Compare(f.Signal(*name.split(".", 1)), operator, number, tolerance)


def _window(first, second):
    return f.Window(*sorted((first, second)))


def _quantile(share, of, window):
    return f.Quantile(share, of.signal, of.operator, of.number, window)


MILLISECONDS = st.integers(0, 1199).map(lambda number: number * SECOND // 1000)
WINDOWS = st.just(f.WHOLE) | st.builds(_window, st.just(0) | MILLISECONDS, MILLISECONDS)
WHERE = comparisons() | st.sampled_from(WORDS).map(
    lambda pair: f.HasText(f.Signal(*pair[0].split(".", 1)), pair[1])
)
EVENTS = st.one_of(
    st.sampled_from(FAULTS).map(f.Onset),
    st.sampled_from(FAULTS).map(f.Cleared),
    st.sampled_from(["contact_force", "journal", "status"]).map(f.Published),
    WHERE.map(f.Becomes),
    WHERE.map(lambda each: f.Published(each.signal.topic, each)),
)
ATOMS = st.one_of(
    WHERE,
    st.sampled_from(FAULTS).map(f.Active),
    EVENTS,
    st.builds(
        f.Count,
        EVENTS,
        st.sampled_from(f.OPERATORS),
        st.sampled_from([0.0, 1.0, 2.0, 40.0, 500.0]),
        WINDOWS,
    ),
    st.builds(_quantile, st.sampled_from([0.01, 0.5, 0.9, 0.99, 1.0]), comparisons(), WINDOWS),
)


def composed(inner, windows=WINDOWS, events=EVENTS):
    """Return the strategy of formulas that have others in them."""
    return st.one_of(
        inner.map(f.Not),
        st.tuples(inner, inner).map(f.And),
        st.tuples(inner, inner).map(f.Or),
        st.builds(f.Implies, inner, inner),
        st.builds(f.Always, inner, windows),
        st.builds(f.Eventually, inner, windows),
        st.builds(f.Until, inner, inner, windows),
        st.builds(f.Until, inner, inner, st.just(f.WHOLE), st.just(True)),
        st.builds(f.After, events | inner, inner),
    )


def formulas():
    """Return the strategy of all formulas."""
    return st.recursive(ATOMS, composed, max_leaves=6)


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
