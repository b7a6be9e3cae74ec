"""Tables of the documents that follow from the code: ``python -m toolchain.reference``."""

from __future__ import annotations

import argparse
import inspect
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import rpud_sim
from rpud_sim.cli.main import build_parser, load_command
from rpud_sim.foundation.verbs import VERBS
from rpud_sim.ros.client import DrillClient
from rpud_sim.ros.drill import health
from rpud_sim.simulation import preset
from rpud_sim.simulation.configuration import (
    CHANGEABLE,
    PARAMETERS,
    Configuration,
    Settings,
)
from rpud_sim.simulation.energy_account import EnergyAccount
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.testing import LockstepDrill

Rows = Sequence[Sequence[str]]

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
_MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.DOTALL)


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


def commands() -> str:
    """Return every command but verbs with its arguments; options of several come first."""
    chosen = next(a for a in build_parser()._actions if isinstance(a, argparse._SubParsersAction))
    options = {n: dict(_arguments(p)) for n, p in chosen.choices.items() if n not in VERBS}
    count = Counter(option for each in options.values() for option in each.items())
    shared = [option for option, number in count.items() if number > 1]
    parts = ["### Options of several commands", table([("option", "meaning"), *shared])]
    for name, each in options.items():
        text = load_command(name).help
        named = (option.split()[0] for option, _ in filter(shared.__contains__, each.items()))
        others = ", ".join(f"`{option}`" for option in named)
        text = f"{text[0].upper()}{text[1:]}.{f' Also takes {others}.' if others else ''}"
        parts.append(f"### rpud {name}\n\n{text}")
        own = [option for option in each.items() if option not in shared]
        parts += [table([("argument", "meaning"), *own])] if own else []
    return "\n\n".join(parts)


def _arguments(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """Yield each argument of a command with its meaning."""
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction) or action.help in (None, argparse.SUPPRESS):
            continue
        value = action.metavar or "|".join(map(str, action.choices or [action.dest.upper()]))
        words = [*action.option_strings, *([] if action.nargs == 0 else [str(value)])]
        meaning = action.help % {**vars(action), "prog": parser.prog}
        yield " ".join(words), meaning


def energy() -> Rows:
    """Return the terms of the energy account."""
    return [("term", "meaning [J]"), *_fields(EnergyAccount)]


def table(rows: Rows) -> str:
    """Return a table in Markdown."""
    head, *others = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    lines = [head, ["---"] * len(head), *others]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def faces() -> str:
    """Return the members of the classes of the package's face, with types."""
    parts = []
    for name in ("simulate", "sweep", "open", "DrillRun", "DrillBag"):
        item = getattr(rpud_sim, name)
        if inspect.isclass(item):
            own = (
                each
                for each in _members(item)
                if each[0].split("(")[0].strip("`") not in _LOW_LEVEL
            )
            rows = [("member", "meaning"), *own]
            parts.append(f"### {name}\n\n{_first_line(item)}\n\n{table(rows)}")
        else:
            call = f"rpud_sim.{name}{_signature(item)}"
            parts.append(f"### {name}\n\n`{call}`\n\n{_first_line(item)}")
    return "\n\n".join(parts)


# Members of an open bag that the commands use.
_LOW_LEVEL = frozenset(
    {"batches", "chunks", "compression", "readable_topics", "unread_offers", "damages", "end_time"}
)
# Members that the plugin and other commands use among themselves.
_INTERNAL = frozenset(
    {
        *("await_connections", "await_delivery", "begin", "beginning"),
        *("disturb", "disturbed_steps", "found", "observe", "pid", "publishers", "record_attempt"),
        *("renew", "status_number", "subscribe", "take", "telemetry", "verdict_lines"),
        *("check_while_waiting", "client", "interrupt", "wait_until"),
    }
)


def drills() -> Rows:
    """Return the members of the three classes that command a drill, and which of them have each."""
    kinds = (rpud_sim.Drill, LockstepDrill, DrillClient)
    members = [dict(_members(kind)) for kind in kinds]
    names = {name.strip("`").partition("(")[0] for each in members for name in each}
    rows = [("member", "meaning", "of")]
    for name in sorted(names - _INTERNAL):
        found = [
            next((item for item in each.items() if re.match(rf"`{name}\b", item[0])), None)
            for each in members
        ]
        call, meaning = next(filter(None, found))
        own = ", ".join(
            kind.__name__ for kind, each in zip(kinds, found, strict=True) if each is not None
        )
        rows.append((call, meaning, "all" if all(found) else own))
    return rows


def diagnostics() -> Rows:
    """Return the entries of /diagnostics with their keys."""
    return [("entry", "keys"), *((entry, keys) for entry, keys in health.KEYS.items())]


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
    """Return the parameters of a function and their defaults."""
    given = inspect.signature(item).parameters.values()
    own = [each.replace(annotation=each.empty) for each in given if each.name != "self"]
    return re.sub(r"<function .* at \w+>", "...", str(inspect.Signature(own)))


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
    "commands": commands,
    "diagnostics": lambda: table(diagnostics()),
    "drills": lambda: table(drills()),
    "energy": lambda: table(energy()),
    "face": faces,
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
