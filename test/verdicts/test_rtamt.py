"""rtamt, another monitor of signal temporal logic, finds the same margins."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_expectations import record_of
from support import examples

from rpud_sim.foundation.time import SECOND
from rpud_sim.verdicts import formulas as f
from rpud_sim.verdicts.evaluation import Evaluation
from rpud_sim.verdicts.steps import LEAST_MARGIN, LEAST_TRUTH, MOST_MARGIN, MOST_TRUTH

rtamt = pytest.importorskip("rtamt")

pytestmark = pytest.mark.extended

NAMES = {"x": f.Signal("reacting_force", "force"), "y": f.Signal("nodal_plane", "velocity")}
UNITS = {"x": "N", "y": "m/s"}


@st.composite
def formulas(draw, depth=4):
    """Draw a formula, and its text for rtamt. Samples are 1 s apart."""
    kinds = ["not", "and", "or", "implies", "always", "eventually", "until"] if depth else []
    kind = draw(st.sampled_from([*kinds, "compare"]))
    if kind == "compare":
        name, operator = draw(st.sampled_from("xy")), draw(st.sampled_from(["<=", ">=", "=="]))
        number = draw(st.integers(-4, 4))
        compare = f.Compare(NAMES[name], operator, f.Number(float(number), UNITS[name]))
        return compare, f"({name} {operator} {number}.0)"
    one, text = draw(formulas(depth - 1))
    if kind == "not":
        return f.Not(one), f"(not {text})"
    if kind in ("and", "or", "implies"):
        other, second = draw(formulas(depth - 1))
        built = {
            "and": f.And((one, other)),
            "or": f.Or((one, other)),
            "implies": f.Implies(one, other),
        }
        return built[kind], f"({text} {kind} {second})"
    start, length = draw(st.integers(0, 3)), draw(st.integers(0, 4))
    if kind == "until":
        # At instants between samples, a window that begins later has another meaning than theirs.
        window, bounds = f.Window(0, length * SECOND), f"[0:{length}]"
        other, second = draw(formulas(depth - 1))
        return f.Until(one, other, window), f"({text} until{bounds} {second})"
    window, bounds = (
        f.Window(start * SECOND, (start + length) * SECOND),
        f"[{start}:{start + length}]",
    )
    if draw(st.booleans()):
        window, bounds = f.WHOLE, ""
    kinds = {"always": f.Always, "eventually": f.Eventually}
    return kinds[kind](one, window), f"({kind}{bounds}{text})"


def margins_of_rtamt(text, x, y):
    specification = rtamt.StlDiscreteTimeSpecification()
    for name in "xy":
        specification.declare_var(name, "float")
    specification.spec = text
    specification.parse()
    return [
        margin for _, margin in specification.evaluate({"time": [*range(len(x))], "x": x, "y": y})
    ]


def steps_of(formula, pairs):
    """Return the step function of a formula, and both signals."""
    x, y = zip(*pairs, strict=True)
    record = record_of(
        force={number * SECOND: value for number, value in enumerate(x)},
        velocity={number * SECOND: value for number, value in enumerate(y)},
    )
    return Evaluation(record, 0, (len(pairs) - 1) * SECOND, 0).steps(formula), [*x], [*y]


values = st.integers(-5, 5).map(float)


@settings(max_examples=examples(200))
@given(formulas(), st.lists(st.tuples(values, values), min_size=2, max_size=15))
def test_the_margins_are_those_of_rtamt(formula, pairs):
    """Beyond its end, rtamt judges what is left of a window: one way in which a run may go on."""
    formula, text = formula
    steps, *signals = steps_of(formula, pairs)
    for number, margin in enumerate(margins_of_rtamt(text, *signals)):
        found = steps.values[:, int(steps.at(number * SECOND))]
        assert found[LEAST_MARGIN] <= margin <= found[MOST_MARGIN], (number, text)
        if math.isfinite(margin) and margin != 0.0:
            sign = math.copysign(1.0, margin)
            assert found[LEAST_TRUTH] <= sign <= found[MOST_TRUTH]


@settings(max_examples=examples(100))
@given(formulas(depth=2), st.lists(st.tuples(values, values), min_size=30, max_size=35))
def test_the_margins_are_exactly_those_of_rtamt_where_all_windows_end_in_time(formula, pairs):
    formula, text = formula
    whole = [part.window for part in formula.walk() if hasattr(part, "window")]
    if f.WHOLE in whole and whole != [f.WHOLE]:
        return
    steps, *signals = steps_of(formula, pairs)
    margin = margins_of_rtamt(text, *signals)[0]
    assert steps.values[LEAST_MARGIN, 0] == steps.values[MOST_MARGIN, 0] == margin
