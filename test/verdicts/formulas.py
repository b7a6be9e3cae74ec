"""Random expectations and records, for Hypothesis."""

from hypothesis import strategies as st

from rpud_sim.foundation.time import SECOND
from rpud_sim.verdicts import Record
from rpud_sim.verdicts.vocabulary import (
    WHOLE,
    Active,
    After,
    Always,
    And,
    Becomes,
    Cleared,
    Compare,
    Count,
    Eventually,
    Implies,
    Message,
    Not,
    Number,
    Onset,
    Or,
    Quantile,
    Says,
    Signal,
    Until,
    Window,
)

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
OPERATORS = ["<", "<=", ">", ">=", "==", "!="]


def signals(names):
    def split(name, hold):
        return Signal(*name.split(".", 1), hold)

    holds = st.sampled_from([None, None, None, SECOND // 50])
    return st.builds(split, st.sampled_from(names), holds)


@st.composite
def comparisons(draw):
    name = draw(st.sampled_from(sorted(NUMBERS)))
    operator = draw(st.sampled_from(OPERATORS))
    number = Number(*draw(st.sampled_from(NUMBERS[name])))
    tolerance = Number(0.0)
    if operator in ("==", "!=") and number.value:
        tolerance = Number(draw(st.sampled_from([0.0, abs(number.value) / 4])), number.unit)
    tolerance = tolerance if tolerance.value else Number(0.0)
    return Compare(draw(signals([name])), operator, number, tolerance)


def words():
    return st.sampled_from(WORDS).flatmap(lambda word: signals([word[0]]).map(_says(word[1])))


def _says(word):
    return lambda signal: Says(signal, word)


def durations():
    return st.integers(0, 1200).map(lambda count: count * SECOND // 1000) | st.integers(0, SECOND)


def windows():
    pairs = st.tuples(durations(), durations()).map(sorted).map(lambda pair: Window(*pair))
    return st.just(WHOLE) | durations().map(lambda end: Window(0, end)) | pairs


def events():
    where = st.just(None) | comparisons().filter(lambda each: each.signal.hold is None)
    messages = st.builds(Message, st.sampled_from(["contact_force", "journal", "status"]))
    chosen = where.map(
        lambda each: Message("contact_force") if each is None else Message(each.signal.topic, each)
    )
    faults = st.sampled_from(FAULTS)
    becomes = st.builds(Becomes, comparisons() | words())
    return faults.map(Onset) | faults.map(Cleared) | messages | chosen | becomes


def quantiles():
    return st.builds(
        lambda share, each, window: Quantile(
            share, Signal(each.signal.topic, each.signal.field), each.operator, each.number, window
        ),
        st.sampled_from([0.01, 0.5, 0.9, 0.99, 1.0]),
        comparisons(),
        windows(),
    )


def counts():
    operators = st.sampled_from(OPERATORS)
    return st.builds(Count, events(), operators, st.integers(0, 60).map(float), windows())


@st.composite
def formulas(draw, depth=3):
    kinds = ATOMS | COMPOSED if depth else ATOMS
    kind = draw(st.sampled_from(sorted(kinds)))
    if kind in ATOMS:
        return draw(ATOMS[kind]())
    return draw(COMPOSED[kind](formulas(depth - 1)))


ATOMS = {
    "compare": comparisons,
    "says": words,
    "active": lambda: st.sampled_from(FAULTS).map(Active),
    "event": events,
    "count": counts,
    "quantile": quantiles,
}


def _several(inner):
    return st.lists(inner, min_size=1, max_size=3).map(tuple)


COMPOSED = {
    "not": lambda inner: st.builds(Not, inner),
    "and": lambda inner: _several(inner).map(And),
    "or": lambda inner: _several(inner).map(Or),
    "implies": lambda inner: st.builds(Implies, inner, inner),
    "always": lambda inner: st.builds(Always, inner, windows()),
    "eventually": lambda inner: st.builds(Eventually, inner, windows()),
    "until": lambda inner: st.builds(Until, inner, inner, windows()),
    "unless": lambda inner: st.builds(Until, inner, inner, st.just(WHOLE), st.just(True)),
    "after": lambda inner: st.builds(After, st.one_of(events(), inner), inner),
}


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
