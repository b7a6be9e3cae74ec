"""Notations of formulas: words of Python, and plain values of YAML with the way back."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rpud_sim.foundation.quantities import Quantity, did_you_mean, shown
from rpud_sim.foundation.yaml_files import Cursor, open_yaml
from rpud_sim.verdicts import formulas as f
from rpud_sim.verdicts.names import Expectation
from rpud_sim.verdicts.units import (
    NUMBER,
    WHOLE,
    ExpectationError,
    Number,
    Window,
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
        raise ExpectationError(f"{shown(name)} is not a topic and a field, as reacting_force.force")
    return f.Signal(match[1], match[2])


def always(formula: f.Formula, within: Any = None, between: Any = None) -> f.Always:
    """Return the formula that ``formula`` holds at every instant of a window."""
    return f.Always(formula, window(within, between))


def eventually(formula: f.Formula, within: Any = None, between: Any = None) -> f.Eventually:
    """Return the formula that ``formula`` holds at some instant of a window."""
    return f.Eventually(formula, window(within, between))


def until(formula: f.Formula, goal: f.Formula, within: Any = None, between: Any = None) -> f.Until:
    """Return the formula that ``goal`` comes in a window and ``formula`` holds until then."""
    return f.Until(formula, goal, window(within, between))


def unless(formula: f.Formula, goal: f.Formula) -> f.Until:
    """Return the formula that ``formula`` holds until ``goal`` comes, or always."""
    return f.Until(formula, goal, WHOLE, True)


def after(trigger: f.Formula, formula: f.Formula) -> f.After:
    """Return the formula that ``formula`` holds at each instant of ``trigger``."""
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
    """Mapping that stands for a formula. Its first key tells the form."""

    make: Callable[..., f.Formula]  # from the fields of the formula
    fields: Mapping[str, str]  # of the formula, by the key that holds it
    may: tuple[str, ...] = ()  # further keys that it may have; outside a window, names of fields


_WINDOW = ("within", "between")
_FORMS = {
    "fault": _Form(f.Active, {"fault": "fault"}),
    "onset": _Form(f.Onset, {"onset": "fault"}),
    "cleared": _Form(f.Cleared, {"cleared": "fault"}),
    "message": _Form(f.Published, {"message": "topic"}, ("where",)),
    "becomes": _Form(f.Becomes, {"becomes": "formula"}),
    "not": _Form(f.Not, {"not": "formula"}),
    "all": _Form(f.And, {"all": "formulas"}),
    "any": _Form(f.Or, {"any": "formulas"}),
    "if": _Form(f.Implies, {"if": "condition", "then": "formula"}),
    "always": _Form(f.Always, {"always": "formula"}, _WINDOW),
    "eventually": _Form(f.Eventually, {"eventually": "formula"}, _WINDOW),
    "hold until": _Form(f.Until, {"hold": "formula", "until": "goal"}, _WINDOW),
    "hold unless": _Form(unless, {"hold": "formula", "unless": "goal"}),
    "after": _Form(f.After, {"after": "trigger", "expect": "formula"}),
    "count": _Form(f.Count, {"count": "event", "is": "number"}, _WINDOW),
    "quantile": _Form(f.Quantile, {"quantile": "share", "of": "signal", "is": "number"}, _WINDOW),
}
_MAIN = tuple(dict.fromkeys(next(iter(form.fields)) for form in _FORMS.values()))
_KEYS = ("name", "requirement", "expect")
_SHARE = Quantity("", "", 0.0, 1.0, exclusive=True)

_ATOM = re.compile(r"\s*(\S+)\s+(.*\S)\s*|\s*([A-Za-z/][\w./\[\]]*)\s*([<>=!].*\S)\s*", re.DOTALL)
_COMPARED = re.compile(rf"(<=|>=|==|!=|<|>|=)\s*({NUMBER}[^+]*?)\s*(?:(?:\+-|±)\s*(.*\S))?")


def read_expectations(path: str | Path) -> tuple[Expectation, ...]:
    """Read a file of expectations; an error names the file and the line."""
    # Without truth values: off is a kind of fault, and `is: true` a text as `is: running`.
    top = open_yaml(path, truth_values=False, error=ExpectationError)
    known, none = ("expectations",), "it holds no expectations:"
    unknown = "{shown} is not expectations"
    entries = top.mapping(known, known, other=none, unknown=unknown, missing=none)
    return parse_expectations(entries["expectations"])


def parse_expectations(cursor: Cursor) -> tuple[Expectation, ...]:
    """Return the expectations of a list."""
    found: dict[str, Expectation] = {}
    other = "{name} is no list with entries"
    for entry in cursor.sequence(other=other):
        expectation = _expectation(entry)
        if expectation.name in found:
            raise entry.refusal(f"name {shown(expectation.name)} is taken already")
        found[expectation.name] = expectation
    if not found:
        raise cursor.refusal(other)
    return tuple(found.values())


def _expectation(cursor: Cursor) -> Expectation:
    """Return the expectation of one entry: ``name`` and ``expect``, perhaps ``requirement``."""
    missing, unknown = "the expectation lacks its {name}", "{shown}: {hint}"
    keys = cursor.mapping(_KEYS, ("name", "expect"), unknown=unknown, missing=missing)
    texts = {key: one.value for key, one in keys.items() if key != "expect"}
    for key, value in texts.items():
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            raise keys[key].refusal("{name} = {shown} is not a text of one line")
    formula = to_formula(keys["expect"])
    with keys["expect"].errors():
        return Expectation(formula=formula, **texts)


def to_formula(cursor: Cursor) -> f.Formula:
    """Return the formula of a plain value.

    The value is a text such as ``reacting_force.force < 45 N``, or a mapping of one of ``_FORMS``.
    """
    with cursor.errors():
        value = cursor.value
        if isinstance(value, str):
            match = _ATOM.fullmatch(value)
            if match is None:
                example = "reacting_force.force < 45 N"
                raise ExpectationError(f"{shown(value)} is no comparison, as {example}")
            return _about(signal(match[1] or match[3]), match[2] or match[4])
        parts = cursor.mapping(other="{shown} is neither a comparison nor a mapping")
        form = _form(value)
        fields: dict[str, Any] = {}
        for key, part in parts.items():
            if key not in _WINDOW:
                fields |= _fields(form.fields.get(key, key), part)
        if _WINDOW[0] in form.may:
            fields["window"] = _window(value)
        if form.make is f.Count:
            if fields["number"].unit:
                raise ExpectationError(f"a count has no unit, given {fields['number']}")
            fields["number"] = fields["number"].value
        return form.make(**fields)


def _form(value: Mapping[Any, Any]) -> _Form:
    """Return the form of a mapping, and check its keys."""
    keys = [str(key) for key in value]
    for name, form in _FORMS.items():
        first, *others = form.fields
        if first not in keys or (first == "hold" and others[0] not in keys):
            continue
        for key in keys:
            if key not in form.fields and key not in form.may:
                free = [each for each in (*form.fields, *form.may) if each not in keys]
                hint = did_you_mean(key, free) if free else "it has all of its keys"
                raise ExpectationError(f"{shown(key)} does not belong to {name}; {hint}")
        for key in others:
            if key not in keys:
                raise ExpectationError(f"{name} lacks its {key}")
        return form
    if "hold" in keys:
        raise ExpectationError("hold lacks its until or unless")
    first = keys[0] if keys else ""
    raise ExpectationError(f"{shown(first)} begins no formula; {did_you_mean(first, _MAIN)}")


def _fields(name: str, cursor: Cursor) -> dict[str, Any]:
    """Return the fields of a formula that a value gives; a comparison gives two."""
    value = cursor.value
    if name == "number":
        match = _COMPARED.fullmatch(value.strip()) if isinstance(value, str) else None
        if match is None or match[3]:
            raise cursor.refusal("is: {shown} is no comparison, as < 45 N")
        return {"operator": _operator(match[1]), name: Number(*parse_quantity(match[2]))}
    if name == "formulas":
        return {name: tuple(map(to_formula, cursor.sequence()))}
    if name == "share":
        return {name: _SHARE.check("quantile", value)}
    if name == "topic":
        if not isinstance(value, str):
            raise cursor.refusal("message = {shown} is no topic")
        return {name: value}
    if name == "signal":
        return {name: signal(value)}
    return {name: value if name == "fault" else to_formula(cursor)}


def _about(about: f.Signal, text: str) -> f.Compare | f.Says:
    """Return the formula about a signal of a text such as ``< 45 N`` or ``is running``."""
    if text.startswith("is "):
        return about.says(text[3:].strip())
    match = _COMPARED.fullmatch(text)
    if match is None:
        raise ExpectationError(
            f"{shown(text)} is no comparison of {about}, as < 45 N, == 0 N +- 0.1 N or is running"
        )
    return about.compare(_operator(match[1]), match[2], match[3] or 0.0)


def _operator(text: str) -> str:
    return "==" if text == "=" else text


def _window(value: Mapping[str, Any]) -> Window:
    between = value.get("between")
    if isinstance(between, list):
        between = [None if each in ("end", None) else each for each in between]
    return window(value.get("within"), between)


def to_plain(formula: f.Formula) -> Any:
    """Return the plain value of a formula, the inverse of ``to_formula``."""
    if isinstance(formula, (f.Compare, f.Says)):
        return str(formula)
    make = unless if isinstance(formula, f.Until) and formula.weak else type(formula)
    form = next(each for each in _FORMS.values() if each.make is make)
    further = {key: key for key in form.may if key not in _WINDOW}
    plain: dict[str, Any] = {}
    for key, field in (*form.fields.items(), *further.items()):
        value = getattr(formula, field)
        if isinstance(formula, (f.Count, f.Quantile)) and field == "number":
            plain[key] = f"{formula.operator} {Number(value) if make is f.Count else value}"
        elif isinstance(value, tuple):
            plain[key] = [to_plain(part) for part in value]
        elif isinstance(value, f.Formula):
            plain[key] = to_plain(value)
        elif value is not None:
            plain[key] = str(value) if isinstance(value, f.Signal) else value
    part = getattr(formula, "window", WHOLE)
    end = "end" if part.end is None else duration_text(part.end)
    if part.start == 0 and part.end is not None:
        plain["within"] = end
    elif part != WHOLE:
        plain["between"] = [duration_text(part.start), end]
    return plain
