"""Files of docs/reference that follow from the code: ``python -m toolchain.reference``."""

from __future__ import annotations

import argparse
import csv
import importlib
import inspect
import io
import re
import sys
import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from rpud_sim.cli.main import COMMANDS, build_parser, load_command
from rpud_sim.foundation.quantities import QUANTITIES
from rpud_sim.model import tolerances
from rpud_sim.simulation import preset
from rpud_sim.simulation.configuration import (
    CHANGEABLE,
    PARAMETERS,
    Configuration,
    Settings,
)
from rpud_sim.simulation.energy_account import EnergyAccount
from rpud_sim.simulation.fault_kinds import KINDS

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "reference"
PACKAGES = (
    "rpud_sim.bag",
    "rpud_sim.simulation",
    "rpud_sim.ros.client",
    "rpud_sim.testing",
    "rpud_sim.verdicts",
    "rpud_sim.recorded.compare",
)
_WIDTH = 100
_FIELD = re.compile(
    r"\s*(?P<type>\S+)\s+(?P<name>\w+)(?:=(?P<value>\S+)|\s*=\s*(?P<constant>\S+))?\s*(?:#\s*(?P<comment>.*))?$"
)


def parameters() -> str:
    """Return every parameter: default, range, whether it may change, meaning; as CSV."""
    drilling, free = Settings(), Settings(Configuration(preset("free")))
    rows = [("parameter", "default", "range", "may change", "meaning")]
    for name, declared in PARAMETERS.items():
        default = _shown(drilling.value(name))
        if name != "regime" and _shown(free.value(name)) != default:
            default += f" (free: {_shown(free.value(name))})"
        allowed = declared.allowed
        may_change = "yes" if name in CHANGEABLE else ""
        rows.append((name, default, allowed.range, may_change, allowed.description))
    return _csv(rows)


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value or "none" if isinstance(value, str) else f"{value:g}"


def faults() -> str:
    """Return every kind of fault: what happens, its magnitude and what it needs; as CSV."""
    rows = [("fault", "what happens", "magnitude", "range", "default", "needs")]
    for name, kind in KINDS.items():
        needs = ", ".join(need.__name__.strip("_").replace("_", " ") for need in kind.needs)
        needs = needs if kind.physical else "channel"
        quantity = kind.magnitude
        if quantity is None:
            rows.append((name, kind.description, "", "", "", needs))
            continue
        default = "of the channel" if kind.in_channel_unit else f"{kind.default:g}"
        rows.append((name, kind.description, quantity.description, quantity.range, default, needs))
    return _csv(rows)


def commands() -> str:
    """Return every command with its arguments and options; as CSV."""
    rows = [("group", "command", "argument", "meaning")]
    chosen = next(a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction))
    for name, parser in chosen.choices.items():
        rows.append((COMMANDS[name][0], f"rpud {name}", "", load_command(name).help))
        for action in parser._actions:
            if isinstance(action, argparse._HelpAction) or action.help in (None, argparse.SUPPRESS):
                continue
            value = action.metavar or "|".join(map(str, action.choices or [action.dest.upper()]))
            words = [*action.option_strings, *([] if action.nargs == 0 else [str(value)])]
            meaning = action.help % {**vars(action), "prog": parser.prog}
            rows.append((COMMANDS[name][0], f"rpud {name}", " ".join(words), meaning))
    return _csv(rows)


def shown_quantities() -> str:
    """Return every quantity of screens, pages and lines: name, symbol, units, messages; as CSV."""
    rows = [("quantity", "name", "symbol", "SI unit", "shown in", "from")]
    for each in QUANTITIES.values():
        sources = ", ".join(each.sources)
        rows.append((each.label, each.name, each.symbol, each.si, each.unit, sources))
    return _csv(rows)


def energy() -> str:
    """Return the terms of the energy account; as CSV."""
    return _csv([("term", "meaning [J]"), *_fields(EnergyAccount)])


def bounds() -> str:
    """Return the tolerances of the engine with the comments above them; as CSV."""
    rows, comment = [("bound", "value", "meaning")], ""
    for line in inspect.getsource(tolerances).splitlines():
        if line.startswith("#"):
            comment = f"{comment} {line.lstrip('# ')}".strip()
        elif found := re.match(r"([A-Z_]+) = (\S+)", line):
            rows.append((found[1], f"{getattr(tolerances, found[1]):g}", comment))
        else:
            comment = ""
    return _csv(rows)


def messages() -> str:
    """Return every field of every message and service: type, name, meaning; as CSV."""
    rows = [("message", "field", "type", "meaning")]
    for path in sorted((ROOT / "msg_defs").glob("*/*.*")):
        name = path.stem
        for line in path.read_text(encoding="utf-8").splitlines():
            if line == "---":
                name = f"{path.stem} response"
                continue
            comment = line.strip()
            if comment.startswith("#"):
                # A comment that goes on below its field.
                if line.startswith(" ") and rows[-1][0] == name:
                    *others, meaning = rows[-1]
                    rows[-1] = (*others, f"{meaning} {comment.lstrip('# ')}")
            elif comment and (field := _FIELD.match(line)):
                value = field["constant"] or field["value"]
                shown = f"{field['name']} = {value}" if value else field["name"]
                rows.append((name, shown, field["type"], field["comment"] or ""))
    return _csv(rows)


def _csv(rows: Iterable[tuple[str, ...]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def python() -> str:
    """Return the public classes and functions with their docstrings, as ``help`` shows them."""
    parts = []
    for name in PACKAGES:
        package = importlib.import_module(name)
        parts += [f"{name}\n{'=' * len(name)}", inspect.getdoc(package) or ""]
        parts += [text for each in package.__all__ for text in _entry(each, getattr(package, each))]
    return "\n\n".join(parts) + "\n"


def _entry(name: str, item: Any) -> Iterator[str]:
    if inspect.isclass(item):
        yield f"class {name}{_signature(item)}\n{_indented(_text(item))}".rstrip()
        for member, value in _members(item).items():
            if not member.startswith("_") and _is_documented(value):
                function = (
                    value.fget if isinstance(value, property) else inspect.unwrap(_function(value))
                )
                form = "" if isinstance(value, property) else _signature(function)
                yield _indented(
                    f"{member}{form}\n{_indented(inspect.getdoc(function) or '')}".rstrip()
                )
    elif callable(item):
        yield f"{name}{_signature(item)}\n{_indented(inspect.getdoc(item) or '')}".rstrip()
    else:
        yield f"{name}: {type(item).__name__}"


def _members(item: type) -> dict[str, Any]:
    """Return the members of a class, first the documented ones of its bases without an entry."""
    own = vars(item)
    bases = [
        each
        for each in reversed(item.__mro__[1:])
        if each.__module__.startswith("rpud_sim.")
        and not hasattr(sys.modules[each.__module__.rpartition(".")[0]], each.__name__)
    ]
    inherited = {
        name: value
        for each in bases
        for name, value in vars(each).items()
        if name not in own and inspect.getdoc(value)
    }
    return {**inherited, **own}


def _function(value: Any) -> Any:
    return getattr(value, "__func__", getattr(value, "func", value))


def _is_documented(value: Any) -> bool:
    return isinstance(value, property) or inspect.isroutine(_function(value))


def _signature(item: Any) -> str:
    if inspect.isclass(item) and issubclass(item, Exception):
        return f"({item.__bases__[0].__name__})"
    try:
        found = inspect.signature(item)
    except ValueError:
        return "()"
    plain = [
        # A function as a default would be shown with its address.
        each.replace(
            annotation=inspect.Parameter.empty,
            default=...
            if callable(each.default) and each.default is not each.empty
            else each.default,
        )
        for each in found.parameters.values()
        if each.name != "self"
    ]
    text = str(found.replace(parameters=plain, return_annotation=inspect.Signature.empty))
    return text.replace("Ellipsis", "...")


def _text(item: type) -> str:
    """Return the docstring of a class, and its fields with their comments."""
    document = inspect.getdoc(item) or ""
    if document.startswith(f"{item.__name__}("):  # made by dataclass or NamedTuple
        document = ""
    fields = [(name, comment) for name, comment in _fields(item) if comment]
    width = max((len(name) for name, _ in fields), default=0)
    lines = [f"{name:{width}}  {comment}" for name, comment in fields]
    return "\n\n".join(filter(None, [document, "\n".join(lines)]))


def _fields(item: type) -> Iterator[tuple[str, str]]:
    """Yield the fields of a class with the comment behind or above each."""
    above = ""
    for line in inspect.getsource(item).splitlines():
        if line.startswith("    # "):
            above = f"{above} {line[6:]}".strip()
        elif found := re.match(r"    (\w+): [^#]*(?:#\s*(.*))?$", line):
            yield found[1], found[2] or above
            above = ""
        else:
            above = ""


def _indented(text: str) -> str:
    return textwrap.indent(text, "    ")


FILES = {
    "parameters.csv": parameters,
    "faults.csv": faults,
    "commands.csv": commands,
    "energy.csv": energy,
    "quantities.csv": shown_quantities,
    "tolerances.csv": bounds,
    "messages.csv": messages,
    "python.txt": python,
}


def main() -> None:
    """Write the files."""
    for name, make in FILES.items():
        (FOLDER / name).write_text(make(), encoding="utf-8")
        print(FOLDER / name)


if __name__ == "__main__":
    main()
