"""Formulas in YAML: from plain values to formulas, and back."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.verdicts.units import (
    NUMBER,
    ExpectationError,
    duration_text,
    parse_quantity,
)
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
    Event,
    Eventually,
    Formula,
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
from rpud_sim.verdicts.words import signal, window

Path = tuple[str | int, ...]

# Keys of each form: those that it must have, and those that it may have. The first tells the form.
_WINDOW = ("within", "between")
FORMS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "signal": (("signal", "is"), ("hold",)),
    "fault": (("fault",), ()),
    "onset": (("onset",), ()),
    "cleared": (("cleared",), ()),
    "message": (("message",), ("where",)),
    "becomes": (("becomes",), ()),
    "not": (("not",), ()),
    "all": (("all",), ()),
    "any": (("any",), ()),
    "if": (("if", "then"), ()),
    "always": (("always",), _WINDOW),
    "eventually": (("eventually",), _WINDOW),
    "hold until": (("hold", "until"), _WINDOW),
    "hold unless": (("hold", "unless"), ()),
    "after": (("after", "expect"), ()),
    "count": (("count", "is"), (*_WINDOW, "until")),
    "quantile": (("quantile", "of", "is"), _WINDOW),
}
_MAIN = tuple(dict.fromkeys(required[0] for required, _ in FORMS.values()))

_ATOM = re.compile(r"\s*(\S+)\s+(.*\S)\s*|\s*([A-Za-z/][\w./\[\]]*)\s*([<>=!].*\S)\s*", re.DOTALL)
_COMPARED = re.compile(rf"(<=|>=|==|!=|<|>|=)\s*({NUMBER}[^+]*?)\s*(?:(?:\+-|±)\s*(.*\S))?")


def to_formula(value: Any, path: Path = ()) -> Formula:
    """Return the formula of a plain value.

    The value is a text such as ``reacting_force.force < 45 N``, or a mapping of one of ``FORMS``.
    ``path`` leads to it in its file, for errors.
    """
    try:
        if isinstance(value, str):
            return _atom(value)
        if not isinstance(value, Mapping):
            raise ExpectationError(f"{shown(value)} is neither a comparison nor a mapping")
        form = _form(value)
        return _READERS[form](value, path)
    except ExpectationError as error:
        raise ExpectationError(error, error.path or path) from None
    except ParameterError as error:
        raise ExpectationError(error, path) from None


def _form(value: Mapping[Any, Any]) -> str:
    keys = [str(key) for key in value]
    for name, (required, optional) in FORMS.items():
        if required[0] not in keys or (required[0] == "hold" and required[1] not in keys):
            continue
        if required[0] == "hold" and "signal" in keys:
            continue
        for key in keys:
            if key not in required and key not in optional:
                free = [each for each in (*required, *optional) if each not in keys]
                hint = did_you_mean(key, free) if free else "it has all of its keys"
                raise ExpectationError(f"{shown(key)} does not belong to {name}; {hint}")
        for key in required:
            if key not in keys:
                raise ExpectationError(f"{name} lacks its {key}")
        return name
    if "hold" in keys:
        raise ExpectationError("hold lacks its until or unless")
    first = keys[0] if keys else ""
    raise ExpectationError(f"{shown(first)} begins no formula; {did_you_mean(first, _MAIN)}")


def _atom(text: str) -> Formula:
    match = _ATOM.fullmatch(text)
    if match is None:
        raise ExpectationError(f"{shown(text)} is no comparison, as reacting_force.force < 45 N")
    name, rest = match[1] or match[3], match[2] or match[4]
    return _about(signal(name), rest)


def _about(about: Signal, text: str) -> Compare | Says:
    if text.startswith("is "):
        return about.says(text[3:].strip())
    match = _COMPARED.fullmatch(text)
    if match is None:
        raise ExpectationError(
            f"{shown(text)} is no comparison of {about}, as < 45 N, == 0 N +- 0.1 N or is running"
        )
    operator = "==" if match[1] == "=" else match[1]
    return about.compare(operator, match[2], match[3] or 0.0)


def _bare(text: Any) -> tuple[str, str]:
    match = _COMPARED.fullmatch(text.strip()) if isinstance(text, str) else None
    if match is None or match[3]:
        raise ExpectationError(f"is: {shown(text)} is no comparison, as < 45 N")
    return "==" if match[1] == "=" else match[1], match[2]


def _signal_form(value: Mapping[str, Any], path: Path) -> Formula:
    about = signal(value["signal"], value.get("hold"))
    text = value["is"]
    if not isinstance(text, str):
        raise ExpectationError(f"is: {shown(text)} is no text, as < 45 N", (*path, "is"))
    return _about(about, text if text[:1] in "<>=!" else f"is {text}")


def _message(value: Mapping[str, Any], path: Path) -> Message:
    where = to_formula(value["where"], (*path, "where")) if "where" in value else None
    if not isinstance(where, (Compare, Says, type(None))):
        raise ExpectationError("where is no comparison", (*path, "where"))
    topic = value["message"]
    if not isinstance(topic, str):
        raise ExpectationError(f"message = {shown(topic)} is no topic")
    return Message("/diagnostics" if topic == "diagnostics" else topic, where)


def _several(name: str) -> Callable[[Mapping[str, Any], Path], tuple[Formula, ...]]:
    def read(value: Mapping[str, Any], path: Path) -> tuple[Formula, ...]:
        parts = value[name]
        if not isinstance(parts, list):
            raise ExpectationError(f"{name} = {shown(parts)} is not a list", (*path, name))
        return tuple(to_formula(part, (*path, name, n)) for n, part in enumerate(parts))

    return read


def _window(value: Mapping[str, Any]) -> Window:
    between = value.get("between")
    if isinstance(between, list):
        between = [None if each in ("end", None) else each for each in between]
    return window(value.get("within"), between)


def _count(value: Mapping[str, Any], path: Path) -> Count:
    event = to_formula(value["count"], (*path, "count"))
    if not isinstance(event, Event):
        raise ExpectationError("count needs an event: onset, cleared, message or becomes")
    operator, number = _bare(value["is"])
    plain, unit = parse_quantity(number)
    if unit:
        raise ExpectationError(f"a count has no unit, given {number}", (*path, "is"))
    goal = _one("until", value, path) if "until" in value else None
    return Count(event, operator, plain, _window(value), goal)


def _quantile(value: Mapping[str, Any], path: Path) -> Quantile:
    share = value["quantile"]
    if isinstance(share, bool) or not isinstance(share, (int, float)):
        raise ExpectationError(f"quantile = {shown(share)} is no number in (0, 1]")
    if not isinstance(value["of"], str):
        raise ExpectationError(f"of = {shown(value['of'])} is no signal", (*path, "of"))
    operator, number = _bare(value["is"])
    about = signal(value["of"])
    return Quantile(float(share), about, operator, Number(*parse_quantity(number)), _window(value))


def _one(name: str, value: Mapping[str, Any], path: Path) -> Formula:
    return to_formula(value[name], (*path, name))


_READERS: Mapping[str, Callable[[Mapping[str, Any], Path], Formula]] = {
    "signal": _signal_form,
    "fault": lambda value, path: Active(value["fault"]),
    "onset": lambda value, path: Onset(value["onset"]),
    "cleared": lambda value, path: Cleared(value["cleared"]),
    "message": _message,
    "becomes": lambda value, path: Becomes(_one("becomes", value, path)),
    "not": lambda value, path: Not(_one("not", value, path)),
    "all": lambda value, path: And(_several("all")(value, path)),
    "any": lambda value, path: Or(_several("any")(value, path)),
    "if": lambda value, path: Implies(_one("if", value, path), _one("then", value, path)),
    "always": lambda value, path: Always(_one("always", value, path), _window(value)),
    "eventually": lambda value, path: Eventually(_one("eventually", value, path), _window(value)),
    "hold until": lambda value, path: Until(
        _one("hold", value, path), _one("until", value, path), _window(value)
    ),
    "hold unless": lambda value, path: Until(
        _one("hold", value, path), _one("unless", value, path), WHOLE, True
    ),
    "after": lambda value, path: After(_one("after", value, path), _one("expect", value, path)),
    "count": _count,
    "quantile": _quantile,
}


def to_plain(formula: Formula) -> Any:
    """Return the plain value of a formula, the inverse of ``to_formula``."""
    if isinstance(formula, (Compare, Says)):
        return _plain_atom(formula)
    if isinstance(formula, Active):
        return {"fault": formula.fault}
    if isinstance(formula, (Onset, Cleared)):
        return {type(formula).__name__.lower(): formula.fault}
    if isinstance(formula, Message):
        where = {} if formula.where is None else {"where": to_plain(formula.where)}
        return {"message": formula.topic, **where}
    if isinstance(formula, (Becomes, Not)):
        return {type(formula).__name__.lower(): to_plain(formula.formula)}
    if isinstance(formula, (And, Or)):
        key = "all" if isinstance(formula, And) else "any"
        return {key: [to_plain(part) for part in formula.formulas]}
    if isinstance(formula, Implies):
        return {"if": to_plain(formula.condition), "then": to_plain(formula.formula)}
    if isinstance(formula, (Always, Eventually)):
        key = type(formula).__name__.lower()
        return {key: to_plain(formula.formula), **_plain_window(formula.window)}
    if isinstance(formula, Until):
        key = "unless" if formula.weak else "until"
        parts = {"hold": to_plain(formula.formula), key: to_plain(formula.goal)}
        return {**parts, **_plain_window(formula.window)}
    if isinstance(formula, After):
        return {"after": to_plain(formula.trigger), "expect": to_plain(formula.formula)}
    if isinstance(formula, Count):
        compared = f"{formula.operator} {Number(formula.number)}"
        event = to_plain(formula.event)
        goal = {} if formula.until is None else {"until": to_plain(formula.until)}
        return {"count": event, "is": compared, **_plain_window(formula.window), **goal}
    assert isinstance(formula, Quantile)
    return {
        "quantile": formula.share,
        "of": str(formula.signal),
        "is": f"{formula.operator} {formula.number}",
        **_plain_window(formula.window),
    }


def _plain_atom(formula: Compare | Says) -> Any:
    if isinstance(formula, Says):
        word = str(formula.word).lower() if isinstance(formula.word, bool) else formula.word
        text = f"is {word}"
    else:
        text = f"{formula.operator} {formula.number}"
        if formula.tolerance != Number(0.0):
            text += f" +- {formula.tolerance}"
    if formula.signal.hold is None:
        return f"{formula.signal} {text}"
    hold = duration_text(formula.signal.hold)
    return {"signal": str(formula.signal), "is": text.removeprefix("is "), "hold": hold}


def _plain_window(part: Window) -> dict[str, Any]:
    if part == WHOLE:
        return {}
    if part.start == 0 and part.end is not None:
        return {"within": duration_text(part.end)}
    end = "end" if part.end is None else duration_text(part.end)
    return {"between": [duration_text(part.start), end]}
