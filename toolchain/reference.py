"""Tables of the documents that follow from the code: ``python -m toolchain.reference``."""

from __future__ import annotations

import argparse
import importlib
import inspect
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import rpud_sim
from rpud_sim.cli.main import COMMANDS, build_parser, load_command
from rpud_sim.foundation.shown_quantities import QUANTITIES
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

Rows = Sequence[Sequence[str]]

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PACKAGES = (
    "rpud_sim.bag",
    "rpud_sim.simulation",
    "rpud_sim.ros.client",
    "rpud_sim.testing",
    "rpud_sim.verdicts",
    "rpud_sim.recorded.compare",
)
_MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)
_FIELD = re.compile(
    r"\s*(?P<type>\S+)\s+(?P<name>\w+)(?:=(?P<value>\S+)|\s*=\s*(?P<constant>\S+))?\s*(?:#\s*(?P<comment>.*))?$"
)


def parameters() -> Rows:
    """Return every parameter: default, range, whether it may change, meaning."""
    drilling, free = Settings(), Settings(Configuration(preset("free")))
    rows = [("parameter", "default", "range", "may change", "meaning")]
    for name, declared in PARAMETERS.items():
        default = _shown(drilling.value(name))
        if name != "regime" and _shown(free.value(name)) != default:
            default += f" (free: {_shown(free.value(name))})"
        allowed = declared.allowed
        may_change = "yes" if name in CHANGEABLE else ""
        rows.append((name, default, allowed.range, may_change, allowed.description))
    return rows


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return value or "none" if isinstance(value, str) else f"{value:g}"


def faults() -> Rows:
    """Return every kind of fault: what happens, its magnitude and what it needs."""
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
    return rows


def commands() -> Rows:
    """Return every command with its arguments and options."""
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
    return rows


def shown_quantities() -> Rows:
    """Return every quantity of screens, pages and lines: name, symbol, units, messages."""
    rows = [("quantity", "name", "symbol", "SI unit", "shown in", "from")]
    for each in QUANTITIES.values():
        sources = ", ".join(each.sources)
        rows.append((each.label, each.name, each.symbol, each.si, each.unit, sources))
    return rows


def energy() -> Rows:
    """Return the terms of the energy account."""
    return [("term", "meaning [J]"), *_fields(EnergyAccount)]


def bounds() -> Rows:
    """Return the tolerances of the engine with the comments above them."""
    rows, comment = [("bound", "value", "meaning")], ""
    for line in inspect.getsource(tolerances).splitlines():
        if line.startswith("#"):
            comment = f"{comment} {line.lstrip('# ')}".strip()
        elif found := re.match(r"([A-Z_]+) = (\S+)", line):
            rows.append((found[1], f"{getattr(tolerances, found[1]):g}", comment))
        else:
            comment = ""
    return rows


def messages() -> Rows:
    """Return every field of every message and service: type, name, meaning."""
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
    return rows


def grouped(rows: Rows, heading: Callable[[str], str] = str) -> str:
    """Return a table for each value of the first column, below a heading."""
    head, *others = rows
    parts = []
    for name, group in groupby(others, key=lambda row: row[0]):
        parts.append(f"### {heading(name)}\n\n{table([head[1:], *(row[1:] for row in group)])}")
    return "\n\n".join(parts)


def table(rows: Rows) -> str:
    """Return a table in Markdown."""
    head, *others = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    lines = [head, ["---"] * len(head), *others]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def faces() -> str:
    """Return the members of the classes of the package's face, with types."""
    parts = []
    for name in ("simulate", "sweep", "open", "DrillRun", "Drill", "DrillBag"):
        item = getattr(rpud_sim, name)
        if inspect.isclass(item):
            rows = [("member", "meaning"), *_members(item)]
            parts.append(f"### {name}\n\n{_first_line(item)}\n\n{table(rows)}")
        else:
            call = f"rpud_sim.{name}{_signature(item)}"
            parts.append(f"### {name}\n\n`{call}`\n\n{_first_line(item)}")
    return "\n\n".join(parts)


def packages() -> str:
    """Return the public names of the other packages, each with the first line of its docstring."""
    parts = []
    for name in PACKAGES:
        package = importlib.import_module(name)
        rows = [("name", "meaning")]
        for each in package.__all__:
            item = getattr(package, each)
            if inspect.isclass(item) or callable(item):
                rows.append((f"`{each}`", _first_line(item)))
            else:
                rows.append((f"`{each}`", f"a {type(item).__name__}"))
        parts.append(f"### {name}\n\n{table(rows)}")
    return "\n\n".join(parts)


def _members(item: type) -> Iterator[tuple[str, str]]:
    """Yield the public members of a class that this package defines."""
    for name, value in inspect.getmembers(item):
        defined = any(name in vars(each) for each in item.__mro__ if each.__module__[:4] == "rpud")
        if (name.startswith("_") and name != "__getitem__") or not defined:
            continue
        shown = f"{name}{_signature(value)}" if callable(value) else name
        shown = "run[topic]" if name == "__getitem__" else shown
        yield f"`{shown}`", _first_line(getattr(value, "func", value))


def _first_line(item: Any) -> str:
    text = (inspect.getdoc(item) or "").split("\n\n")[0].replace("\n", " ").replace("``", "`")
    return "" if text.startswith(f"{getattr(item, '__name__', '')}(") else text


def _signature(item: Any) -> str:
    """Return a signature with its types, without the object itself."""
    found = inspect.signature(item)
    own = [
        each.replace(annotation=_Bare(each.annotation))
        for each in found.parameters.values()
        if each.name != "self"
    ]
    text = str(found.replace(parameters=own, return_annotation=_Bare(found.return_annotation)))
    return text.replace("pandas.", "").replace(" | os.PathLike[str]", "")


class _Bare(str):
    """Annotation that is shown without quotes."""

    def __repr__(self) -> str:
        return str(self)


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


TABLES: dict[str, Callable[[], str]] = {
    "parameters": lambda: table(parameters()),
    "faults": lambda: table(faults()),
    "commands": lambda: grouped([row[1:] for row in commands()]),
    "energy": lambda: table(energy()),
    "quantities": lambda: table(shown_quantities()),
    "tolerances": lambda: table(bounds()),
    "messages": lambda: grouped(messages()),
    "face": faces,
    "packages": packages,
}


def filled(text: str) -> str:
    """Return the text of a page with every marked table replaced."""

    def fill(found: re.Match[str]) -> str:
        return f"{found[1]}\n{TABLES[found[2]]()}\n\n{found[3]}"

    return _MARKED.sub(fill, text)


def pages() -> list[Path]:
    """Return the pages with marked tables."""
    return [page for page in sorted(DOCS.glob("**/*.md")) if _MARKED.search(page.read_text())]


def main() -> None:
    """Write the tables."""
    for page in pages():
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")
        print(page)


if __name__ == "__main__":
    main()
