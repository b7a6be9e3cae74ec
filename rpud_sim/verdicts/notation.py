"""Notations of formulas: words of Python, and plain values of YAML with the way back."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import rpud_sim.verdicts.formulas as f
from rpud_sim.foundation.quantities import ParameterError, Quantity, did_you_mean, short_repr
from rpud_sim.foundation.schema import Reader, key, line, list_of, raw_reader, read
from rpud_sim.foundation.yaml_files import YamlNode, open_yaml
from rpud_sim.verdicts.names import Expectation
from rpud_sim.verdicts.units import (
    NUMBER,
    WHOLE,
    Number,
    duration_text,
    parse_quantity,
    to_number,
    window,
)

_SIGNAL = re.compile(r"([A-Za-z/][\w/]*)\.(\S.*)")


def signal(name: str) -> f.Signal:
    """Return a signal by topic and field, as in ``reacting_force.force``."""
    match = _SIGNAL.fullmatch(name) if isinstance(name, str) else None
    if match is None:
        raise ParameterError(
            f"{short_repr(name)} is not a topic and a field, as reacting_force.force"
        )
    return f.Signal(match[1], match[2])


def always(formula: f.Formula, within: Any = None, between: Any = None) -> f.Always:
    """Return the formula that ``formula`` holds at all times in a window."""
    return f.Always(formula, window(within, between))


def eventually(formula: f.Formula, within: Any = None, between: Any = None) -> f.Eventually:
    """Return the formula that ``formula`` holds at some time in a window."""
    return f.Eventually(formula, window(within, between))


def until(formula: f.Formula, goal: f.Formula, within: Any = None, between: Any = None) -> f.Until:
    """Return the formula that ``goal`` comes in a window and ``formula`` holds until then."""
    return f.Until(formula, goal, window(within, between))


def unless(formula: f.Formula, goal: f.Formula) -> f.Until:
    """Return the formula that ``formula`` holds until ``goal`` comes, or always."""
    return f.Until(formula, goal, WHOLE, True)


def after(trigger: f.Formula, formula: f.Formula) -> f.After:
    """Return the formula that ``formula`` holds at each time of ``trigger``."""
    return f.After(trigger, formula)


def count(
    event: f.Event,
    operator: str,
    number: float,
    within: Any = None,
    between: Any = None,
) -> f.Count:
    """Return the comparison of the number of events in a window."""
    return f.Count(event, operator, float(number), window(within, between))


def quantile(
    share: float,
    of: f.Signal,
    operator: str,
    number: str | float,
    within: Any = None,
    between: Any = None,
) -> f.Quantile:
    """Return the comparison of a quantile of a signal's messages in a window."""
    return f.Quantile(float(share), of, operator, to_number(number), window(within, between))


class _Form(NamedTuple):
    """Mapping of a formula. Its first key gives the form."""

    make: Callable[..., f.Formula]  # from the fields of the formula
    fields: Mapping[str, str]  # of the formula, by the key that holds it
    may: tuple[str, ...] = ()  # further keys that it may have, which are names of fields


_WINDOW = ("within", "between")
_FORMS = (
    _Form(f.Active, {"fault": "fault"}),
    _Form(f.Onset, {"onset": "fault"}),
    _Form(f.Cleared, {"cleared": "fault"}),
    _Form(f.Published, {"message": "topic"}, ("where",)),
    _Form(f.Becomes, {"becomes": "formula"}),
    _Form(f.Not, {"not": "formula"}),
    _Form(f.And, {"all": "formulas"}),
    _Form(f.Or, {"any": "formulas"}),
    _Form(f.Implies, {"if": "condition", "then": "formula"}),
    _Form(f.Always, {"always": "formula"}, _WINDOW),
    _Form(f.Eventually, {"eventually": "formula"}, _WINDOW),
    _Form(unless, {"hold": "formula", "unless": "goal"}),
    _Form(f.Until, {"hold": "formula", "until": "goal"}, _WINDOW),
    _Form(f.After, {"after": "trigger", "expect": "formula"}),
    _Form(f.Count, {"count": "event", "is": "number"}, _WINDOW),
    _Form(f.Quantile, {"quantile": "share", "of": "signal", "is": "number"}, _WINDOW),
)
_MAIN = tuple(dict.fromkeys(next(iter(form.fields)) for form in _FORMS))

_ATOM = re.compile(r"\s*(\S+)\s+(.*\S)\s*|\s*([A-Za-z/][\w./\[\]]*)\s*([<>=!].*\S)\s*", re.DOTALL)
_COMPARED = re.compile(rf"(<=|>=|==|!=|<|>|=)\s*({NUMBER}[^+]*?)\s*(?:(?:\+-|±)\s*(.*\S))?")


def read_expectations(path: str | Path) -> tuple[Expectation, ...]:
    """Read a file of expectations; an error names the file and the line."""
    return tuple(read(open_yaml(path), _ExpectationFile).expectations)


def parse_expectations(cursor: YamlNode) -> tuple[Expectation, ...]:
    """Return the expectations of a list."""
    found: dict[str, Expectation] = {}
    for entry, expectation in zip(cursor.sequence(), list_of(_expectation, 1)(cursor), strict=True):
        if expectation.name in found:
            raise entry.error(f"name {short_repr(expectation.name)} is taken already")
        found[expectation.name] = expectation
    return tuple(found.values())


def _expectation(cursor: YamlNode) -> Expectation:
    entry: _ExpectationEntry = read(cursor, _ExpectationEntry)
    with cursor.get("expect").errors():
        return Expectation(entry.name, entry.expect, entry.requirement)


def to_formula(cursor: YamlNode) -> f.Formula:
    """Return the formula of a plain value.

    The value is a text such as ``reacting_force.force < 45 N``, or a mapping of one of ``_FORMS``.
    """
    if isinstance(cursor.value, str):
        with cursor.errors():
            return _comparison(cursor.value)
    form = _form(cursor)
    names = {**form.fields, **{key: key for key in form.may}}
    cursor.mapping(names, form.fields)
    given = read(cursor, {key: _READERS.get(name, to_formula) for key, name in names.items()})
    fields = {names[key]: value for key, value in given.items()}
    with cursor.errors():
        if form.may == _WINDOW:
            fields["window"] = window(*(fields.pop(key, None) for key in _WINDOW))
        if "number" in fields:
            fields["operator"], fields["number"] = fields["number"]
        if form.make is f.Count:
            if fields["number"].unit:
                raise ParameterError(f"a count has no unit, given {fields['number']}")
            fields["number"] = fields["number"].value
        return form.make(**fields)


def _form(cursor: YamlNode) -> _Form:
    """Return the form of a mapping: that with the first key, and of two that with most keys."""
    keys = [str(key) for key in cursor.mapping()]
    forms = [form for form in _FORMS if next(iter(form.fields)) in keys]
    if not forms:
        first = keys[0] if keys else ""
        raise cursor.error(f"{short_repr(first)} begins no formula{did_you_mean(first, _MAIN)}")
    chosen = [form for form in forms if form.fields.keys() <= {*keys}] or forms
    if len(chosen) > 1:
        raise cursor.error(f"{' or '.join([*each.fields][-1] for each in chosen)} is missing")
    return chosen[0]


def _comparison(text: str) -> f.Compare | f.HasText:
    """Return the formula of a text such as ``status.state is running``."""
    match = _ATOM.fullmatch(text)
    if match is None:
        raise ParameterError(
            f"{short_repr(text)} is not a comparison, as reacting_force.force < 45 N"
        )
    return _about(signal(match[1] or match[3]), match[2] or match[4])


def _number(cursor: YamlNode) -> tuple[str, Number]:
    value = cursor.value
    match = _COMPARED.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None or match[3]:
        raise cursor.wrong("is not a comparison, as < 45 N")
    return _operator(match[1]), Number(*parse_quantity(match[2]))


def _between(cursor: YamlNode) -> Any:
    if not isinstance(cursor.value, list):
        return cursor.value
    return [None if each in ("end", None) else each for each in cursor.value]


_READERS: Mapping[str, Reader] = {  # of the fields that are not formulas
    "fault": raw_reader,
    "formulas": list_of(to_formula),
    "number": _number,
    "share": Quantity("", "", 0.0, 1.0, exclusive=True),
    "signal": lambda cursor: signal(cursor.value),
    "topic": line,
    "within": raw_reader,
    "between": _between,
}


@dataclasses.dataclass(frozen=True)
class _ExpectationEntry:
    name: str = key(line)
    expect: f.Formula = key(to_formula)
    requirement: str = key(line, "")


@dataclasses.dataclass(frozen=True)
class _ExpectationFile:
    expectations: tuple[Expectation, ...] = key(parse_expectations)


def _about(about: f.Signal, text: str) -> f.Compare | f.HasText:
    """Return the formula about a signal of a text such as ``< 45 N`` or ``is running``."""
    if text.startswith("is "):
        return about.has_text(text[3:].strip())
    match = _COMPARED.fullmatch(text)
    if match is None:
        raise ParameterError(
            f"{short_repr(text)} is not a comparison of {about}: < 45 N, == 0 N +- 0.1 N or is "
            "running"
        )
    return about.compare(_operator(match[1]), match[2], match[3] or 0.0)


def _operator(text: str) -> str:
    return "==" if text == "=" else text


def to_text(formula: f.Formula) -> str:
    """Return a formula as one line with the words of a file, as ``always(timing.lag < 1 s)``."""
    return _line(to_plain(formula))


def _line(plain: Any) -> str:
    if isinstance(plain, list):  # of formulas
        return ", ".join(map(_line, plain))
    if not isinstance(plain, dict):
        return str(plain)
    word, *others = plain
    spans = {key: " and ".join(plain[key]) for key in others if key == "between"}
    rest = [f"{key} {spans.get(key) or _line(plain[key])}" for key in others]
    return f"{word}({', '.join([_line(plain[word]), *rest])})"


def to_plain(formula: f.Formula) -> Any:
    """Return the plain value of a formula, the inverse of ``to_formula``."""
    if isinstance(formula, (f.Compare, f.HasText)):
        return str(formula)
    make = unless if isinstance(formula, f.Until) and formula.weak else type(formula)
    form = next(each for each in _FORMS if each.make is make)
    further = {key: key for key in form.may if key not in _WINDOW}
    plain: dict[str, Any] = {}
    for name, field in (*form.fields.items(), *further.items()):
        value = getattr(formula, field)
        if isinstance(formula, (f.Count, f.Quantile)) and field == "number":
            plain[name] = f"{formula.operator} {Number(value) if make is f.Count else value}"
        elif isinstance(value, tuple):
            plain[name] = [to_plain(part) for part in value]
        elif isinstance(value, f.Formula):
            plain[name] = to_plain(value)
        elif value is not None:
            plain[name] = str(value) if isinstance(value, f.Signal) else value
    part = getattr(formula, "window", WHOLE)
    end = "end" if part.end is None else duration_text(part.end)
    if part.start == 0 and part.end is not None:
        plain["within"] = end
    elif part != WHOLE:
        plain["between"] = [duration_text(part.start), end]
    return plain
