"""The step functions are what the definitions give, written out nanosecond by nanosecond."""

import math

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from random_expectations import composed, record_of
from support import examples

from rpud_sim.verdicts import formulas as f
from rpud_sim.verdicts.evaluation import Evaluation

UNKNOWN = (-math.inf, math.inf, -1.0, 1.0)
FORCE, WEIGHT = f.Signal("reacting_force", "force"), f.Signal("status", "weight_on_bit")


def compared(signal, operator, number):
    return f.Compare(signal, operator, f.Number(number, "N" if number else ""))


def comparisons():
    return st.builds(
        compared,
        st.sampled_from([FORCE, WEIGHT]),
        st.sampled_from(["<", "<=", ">", ">=", "==", "!="]),
        st.sampled_from([0.0, 1.0, 2.0]),
    )


def windows():
    pairs = st.tuples(st.integers(0, 8), st.integers(0, 8)).map(sorted)
    return st.just(f.WHOLE) | pairs.map(lambda pair: f.Window(*pair)) | st.just(f.Window(2, None))


def events():
    messages = comparisons().map(lambda each: f.Published(each.signal.topic, each))
    messages |= st.sampled_from(["reacting_force", "status"]).map(f.Published)
    return messages | st.builds(f.Becomes, comparisons())


@st.composite
def atoms(draw):
    kind = draw(st.sampled_from(["compare", "event", "count", "quantile"]))
    each, window = draw(comparisons()), draw(windows())
    if kind == "event":
        return draw(events())
    if kind == "count":
        operator, number = draw(st.sampled_from(["<", ">=", "=="])), draw(st.sampled_from([0, 2]))
        return f.Count(draw(events()), operator, float(number), window)
    if kind == "quantile":
        share = draw(st.sampled_from([0.3, 0.5, 1.0]))
        return f.Quantile(share, each.signal, each.operator, each.number, window)
    return each


def formulas():
    return st.recursive(atoms(), lambda inner: composed(inner, windows(), events()), max_leaves=6)


def samples(least):
    values = st.sampled_from([0.0, 1.0, 2.0, 3.0, math.nan])
    return st.dictionaries(st.integers(0, 12), values, min_size=least, max_size=6)


class Oracle:
    """Definitions of docs/reference/expectations.md, one instant at a time."""

    def __init__(self, force, weight):
        self.signals = {"reacting_force": force, "status": weight}
        self.found = {}
        stamps = [*force, *weight]
        self.begin, self.end = min(force or weight), max(stamps)

    def at(self, formula, time):
        """Return the bounds, and whether the formula means nothing yet."""
        if (formula, time) not in self.found:
            self.found[formula, time] = self.computed(formula, time)
        return self.found[formula, time]

    def computed(self, formula, time):
        if time > self.end:
            return UNKNOWN, False
        bounds, absent = getattr(self, type(formula).__name__.lower())(formula, time)
        return (UNKNOWN, True) if absent else (bounds, False)

    def known(self, formula, time):
        return self.at(formula, time)[0]

    def together(self, parts, choose):
        bounds = tuple(choose(each) for each in zip(*(part[0] for part in parts), strict=True))
        return bounds, any(part[1] for part in parts) and bounds[2] < bounds[3]

    def value(self, signal, time):
        """Return the value that holds; None if there is none yet."""
        stamps = [stamp for stamp in self.signals[signal.topic] if stamp <= time]
        return self.signals[signal.topic][max(stamps)] if stamps else None

    def judged(self, value, operator, number):
        if math.isnan(value):
            return (
                (-math.inf, 0.0, -1.0, 1.0)
                if operator == "=="
                else ((0.0, math.inf, -1.0, 1.0) if operator == "!=" else UNKNOWN)
            )
        margin = {"<": number - value, ">": value - number, "=": -abs(value - number)}
        margin["!"] = -margin["="]
        true = {
            "<": value < number,
            "<=": value <= number,
            ">": value > number,
            ">=": value >= number,
            "==": value == number,
            "!=": value != number,
        }[operator]
        return (margin[operator[0]],) * 2 + (1.0 if true else -1.0,) * 2

    def compare(self, formula, time):
        value = self.value(formula.signal, time)
        if value is None:
            return UNKNOWN, True
        return self.judged(value, formula.operator, formula.number.value), False

    def published(self, formula, time):
        samples = self.signals[formula.topic]
        if not any(self.begin <= stamp for stamp in samples):
            return UNKNOWN, True
        if time not in samples:
            return (-math.inf, -math.inf, -1.0, -1.0), False
        where = formula.where
        if where is None:
            return (math.inf, math.inf, 1.0, 1.0), False
        return self.judged(samples[time], where.operator, where.number.value), False

    def becomes(self, formula, time):
        inner = [self.at(formula.formula, each) for each in range(self.begin, self.end + 1)]
        if all(absent for _, absent in inner):
            return UNKNOWN, True
        (_, _, least, most), absent = inner[time - self.begin]
        before, unheard = inner[time - self.begin - 1] if time > self.begin else (None, True)
        false = (-math.inf, -math.inf, -1.0, -1.0)
        if absent or most < 0.0:
            return false, False
        if least < 0.0:
            return UNKNOWN, False
        if unheard or before[3] < 0.0:
            return (math.inf, math.inf, 1.0, 1.0), False
        return (false, False) if before[2] > 0.0 else (UNKNOWN, False)

    def not_(self, formula, time):
        (low, high, least, most), absent = self.at(formula.formula, time)
        return (-high, -low, -most, -least), absent

    def and_(self, formula, time):
        return self.together([self.at(each, time) for each in formula.formulas], min)

    def or_(self, formula, time):
        return self.together([self.at(each, time) for each in formula.formulas], max)

    def implies(self, formula, time):
        return self.together(
            [self.not_(f.Not(formula.condition), time), self.at(formula.formula, time)], max
        )

    def window(self, window, time):
        last = self.end if window.end is None else time + window.end
        return range(time + window.start, last + 1)

    def quantified(self, formula, time, choose):
        times = self.window(formula.window, time)
        found = [self.at(formula.formula, each) for each in times] or [(UNKNOWN, False)]
        heard = [bounds for bounds, absent in found if not absent]
        if not heard:
            return UNKNOWN, True
        return tuple(choose(each) for each in zip(*heard, strict=True)), False

    def always(self, formula, time):
        return self.quantified(formula, time, min)

    def eventually(self, formula, time):
        return self.quantified(formula, time, max)

    def until(self, formula, time):
        window = formula.window
        candidates = []
        goals = self.window(window, time)
        for goal in goals or [
            time + window.start
        ]:  # of a time after the recording nothing is known
            parts = [self.known(formula.goal, goal)]
            parts += [self.known(formula.formula, each) for each in range(time, goal)]
            candidates.append(tuple(min(each) for each in zip(*parts, strict=True)))
        bounds = tuple(max(each) for each in zip(*candidates, strict=True))
        absent = any(self.at(part, time)[1] for part in (formula.formula, formula.goal))
        came = (UNKNOWN, True) if absent and bounds[2] < bounds[3] else (bounds, False)
        if not formula.weak:
            return came
        return self.together([came, self.always(f.Always(formula.formula), time)], max)

    def after(self, formula, time):
        trigger = formula.trigger
        trigger = trigger if isinstance(trigger, f.Event) else f.Becomes(trigger)
        found, came = [], False
        for each in range(time, self.end + 1):
            happens, unheard = self.at(trigger, each)
            if unheard or happens[3] < 0.0:
                continue
            came |= happens[2] > 0.0
            low, high, least, most = happens
            implied = self.together(
                [((-high, -low, -most, -least), False), self.at(formula.formula, each)], max
            )
            if not implied[1]:
                found.append(implied[0])
        if not found:
            return UNKNOWN, True
        bounds = tuple(min(each) for each in zip(*found, strict=True))
        return (UNKNOWN if bounds[2] > 0.0 and not came else bounds), False

    def count(self, formula, time):
        every = [self.at(formula.event, each) for each in range(self.begin, self.end + 1)]
        if all(absent for _, absent in every):
            return UNKNOWN, True
        times = self.window(formula.window, time)
        window = formula.window
        beyond = time + (window.start if window.end is None else window.end) > self.end
        found = [self.known(formula.event, each) for each in times if each <= self.end]
        low = sum(bounds[2] > 0.0 for bounds in found)
        high = math.inf if beyond else sum(bounds[3] > 0.0 for bounds in found)
        unsure = [not absent and bounds[2] < bounds[3] for bounds, absent in every]
        for first in range(self.begin, self.end):  # any number of events in two such instants
            if isinstance(formula.event, f.Published):
                break
            if all(unsure[first - self.begin :][:2]) and {first, first + 1} & {*times}:
                high = math.inf
        return self.between(low, high, formula.operator, formula.number), False

    def between(self, low, high, operator, number):
        if operator in ("==", "!="):
            far = max(abs(low - number), abs(high - number))
            near = 0.0 if low <= number <= high else min(abs(low - number), abs(high - number))
            equal = (-far, -near, 1.0 if far == 0.0 else -1.0, 1.0 if near == 0.0 else -1.0)
            return equal if operator == "==" else (near, far, -equal[3], -equal[2])
        ends = [self.judged(each, operator, number) for each in (low, high)]
        return tuple(
            choose(ends[0][row], ends[1][row])
            for row, choose in ((0, min), (1, max), (2, min), (3, max))
        )

    def quantile(self, formula, time):
        samples = self.signals[formula.signal.topic]
        if not any(stamp >= self.begin for stamp in samples):
            return UNKNOWN, True
        window = formula.window
        beyond = time + (window.start if window.end is None else window.end) > self.end
        times = self.window(window, time)
        found = [value for stamp, value in samples.items() if stamp in times]
        low, high = -math.inf, math.inf
        if found and not beyond:
            place = math.ceil(round(formula.share * 10) * len(found) / 10) - 1
            low = sorted(-math.inf if math.isnan(each) else each for each in found)[place]
            high = sorted(math.inf if math.isnan(each) else each for each in found)[place]
        return self.between(low, high, formula.operator, formula.number.value), False


for _name in ("not", "and", "or"):
    setattr(Oracle, _name, getattr(Oracle, f"{_name}_"))


@settings(max_examples=examples(150), deadline=None)
@given(formulas(), samples(1), samples(1))
@example(  # whether the weight held before its first message is not known
    f.Until(
        compared(f.Signal("status", "weight_on_bit"), "<", 1.0),
        compared(f.Signal("reacting_force", "force"), "<", 1.0),
        f.Window(2, None),
    ),
    {0: 0.0},
    {1: 0.0, 2: 0.0},
)
def test_each_instant_has_the_value_of_the_definitions(formula, force, weight):
    record = record_of(force=force, weight=weight)
    oracle = Oracle(force, weight)
    begin, end = record.span(["reacting_force", "status"])
    assert (begin, end) == (oracle.begin, oracle.end)
    steps = Evaluation(record, begin, end, 0).steps(formula)
    for time in range(begin, end + 1):
        number = int(steps.at(np.array([time]))[0])
        found = tuple(steps.values[:, number].tolist()), bool(steps.absent[number])
        bounds, absent = oracle.at(formula, time)
        assert found[1] == absent, (time, formula)
        assert absent or found[0] == bounds, (time, formula)
