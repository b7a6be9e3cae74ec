"""Reading of YAML from users: a value with its place, or an error in one line.

A reader opens a file and asks the cursor for what it expects. Each error names file and line::

    top = open_yaml(path, truth_values=False, error=FaultError)
    keys = top.mapping(("seed", "faults"), needed=("faults",))
    for entry in keys["faults"].sequence():
        with entry.errors():  # of code that knows no file: FILE:3: ...
            Fault(**{key: each.value for key, each in entry.mapping(_KEYS).items()})
    seed = top.get("seed", 0).check(SEED)  # FILE:1: seed = -1 is outside its range [0, 9]
    raise keys["faults"].refusal("{name} = {shown} is empty")  # FILE:2: faults = [] is empty

Without lines, as of ``cursor_at``, errors name the path of the value instead, as in
``FILE: swept.free_mass.minimum is missing``.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from rpud_sim.foundation.quantities import Allowed, ParameterError, did_you_mean, shown, shown_name

# Files for this are written by hand. A longer file is something else and takes seconds to read.
MOST_BYTES = 100_000


class _Loader(yaml.SafeLoader):
    """Loader of YAML in which 1e-3 and 1.96e11 are numbers, as in YAML 1.2 and for ROS.

    It rejects aliases, as ROS does, because a short file with them can become very large, and
    duplicate keys.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.composer.ComposerError(
                None, None, "aliases are not allowed here", self.peek_event().start_mark
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        mapping = super().construct_mapping(node, deep)
        if len(mapping) < len(node.value):
            raise yaml.constructor.ConstructorError(
                None, None, "a key stands twice in one mapping", node.start_mark
            )
        return mapping


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


class _LoaderWithoutTruthValues(_Loader):
    pass


_LoaderWithoutTruthValues.yaml_implicit_resolvers = {
    first: [resolver for resolver in resolvers if resolver[0] != "tag:yaml.org,2002:bool"]
    for first, resolvers in _Loader.yaml_implicit_resolvers.items()
}

# PyYAML raises these as well: for a text that does not fit its tag, or is nested too deeply.
_PYYAML_ERRORS = (ValueError, LookupError, AttributeError, TypeError, OverflowError, RecursionError)


Place = tuple[str | int, ...]
Lines = Mapping[Place, int]


def _read_yaml(text: str, truth_values: bool) -> tuple[Any, Lines]:
    """Return the value of a text, and the line of each key and entry, from 1 on."""
    lines: dict[Place, int] = {}

    def visit(node: Any, place: Place, line: int) -> None:
        lines[place] = line
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                visit(value, (*place, str(key.value)), key.start_mark.line + 1)
        elif isinstance(node, yaml.SequenceNode):
            for number, value in enumerate(node.value):
                visit(value, (*place, number), value.start_mark.line + 1)

    try:
        loader = (_Loader if truth_values else _LoaderWithoutTruthValues)(text)
        if (whole := loader.get_single_node()) is None:
            return None, {(): 1}
        visit(whole, (), whole.start_mark.line + 1)
        return loader.construct_document(whole), lines
    except (yaml.YAMLError, *_PYYAML_ERRORS) as error:
        raise ParameterError(f"is not YAML: {' '.join(str(error).split())}") from None


def parse_yaml(text: str, truth_values: bool = True) -> Any:
    """Return the value of a text in YAML; without ``truth_values`` off is a word."""
    return _read_yaml(text, truth_values)[0]


@dataclasses.dataclass(frozen=True)
class Source:
    """Origin of cursors, and the beginning of their errors."""

    file: str  # its name, or that of an option
    error: type[ValueError] = ParameterError  # class of the errors
    lines: Lines = dataclasses.field(default_factory=dict)  # of places; empty if unknown

    def head(self, place: Place) -> str:
        """Return the beginning of an error about a place, or the nearest known one around it."""
        while place and place not in self.lines:
            place = place[:-1]
        return f"{self.file}:{self.lines[place]}: " if self.lines else f"{self.file}: "


@dataclasses.dataclass(frozen=True)
class Cursor:
    """Value in YAML and its place; texts of refusals may use {name}, {shown} and {hint}."""

    value: Any
    source: Source
    name: str = ""  # its key, or the path to it where lines are unknown
    place: Place = ()  # keys and numbers that lead to it

    @property
    def prefix(self) -> str:
        """Beginning of an error: file, and line or path."""
        path = self.name and not self.source.lines
        return self.source.head(self.place) + (f"{self.name}: " if path else "")

    def refusal(self, text: str, known: Iterable[str] = ()) -> ValueError:
        """Return an error in one line; ``known`` are the names for {names} and {hint}."""
        known = tuple(known)
        words = {"name": self.name, "shown": shown(self.value), "names": ", ".join(known)}
        hint = did_you_mean(self.value, known) if known else ""
        unnamed = dataclasses.replace(self, name="") if text.startswith("{name}") else self
        return unnamed._error(text.format(**words, hint=hint))

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Context that gives its place to errors of code that knows none."""
        try:
            yield
        except ParameterError as error:
            raise (error if "place" in vars(error) else self._error(str(error))) from None

    def mapping(
        self,
        known: Iterable[str] | None = None,
        needed: Iterable[str] = (),
        *,
        other: str = "{shown} is not a mapping",
        unknown: str = "{shown} is not one of {names}",
        missing: str = "{name} is missing",
    ) -> dict[Any, Cursor]:
        """Return the values of a mapping by key; it may have ``known`` keys, None for any."""
        if not isinstance(self.value, Mapping):
            raise self.refusal(other)
        found = {key: self._at(key, value) for key, value in self.value.items()}
        if known is not None:
            known = tuple(known)
            for key, each in found.items():
                if not (isinstance(key, str) and key in known):
                    raise dataclasses.replace(each, value=key).refusal(unknown, known)
        for key in needed:
            if key not in found:
                raise dataclasses.replace(self._at(key, None), place=self.place).refusal(missing)
        return found

    def file_mapping(self, kind: str) -> dict[Any, Cursor]:
        """Return the values of the mapping that is a whole file of a kind."""
        if not isinstance(self.value, Mapping):
            raise self.source.error(f"{self.source.file} is not {kind}: it holds no mapping")
        return self.mapping()

    def get(self, key: str, default: Any = None) -> Cursor:
        return self._at(key, self.value.get(key, default))

    def sequence(self, *, other: str = "{name} = {shown} is not a list") -> list[Cursor]:
        """Return the entries of a list, or refuse what is none by the text ``other``."""
        if not isinstance(self.value, list):
            raise self.refusal(other)
        return [
            Cursor(value, self.source, f"{self.name}[{index}]", (*self.place, index))
            for index, value in enumerate(self.value)
        ]

    def check(self, allowed: Allowed) -> Any:
        """Return the value as a quantity, choice, flag or text takes it."""
        with dataclasses.replace(self, name="").errors():
            return allowed.check(self.name, self.value)

    def _at(self, key: Any, value: Any) -> Cursor:
        name = shown_name(key)
        if self.name and not self.source.lines:
            name = f"{self.name}.{name}"
        return Cursor(value, self.source, name, (*self.place, str(key)))

    def _error(self, text: str) -> ValueError:
        error = self.source.error(self.prefix + text)
        vars(error)["place"] = self.place
        return error


def open_yaml(
    path: str | Path,
    *,
    truth_values: bool = True,
    error: type[ValueError] = ParameterError,
    lines: bool = True,
) -> Cursor:
    """Return a cursor at the value of a file; without ``lines`` errors name paths."""
    try:
        with open(path, "rb") as file:
            content = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as failure:  # a name with a null character is a ValueError
        reason = failure.strerror if isinstance(failure, OSError) else failure
        raise error(f"{path}: {reason}") from None
    if len(content) > MOST_BYTES:
        raise error(f"{path} is longer than the {MOST_BYTES} bytes that it may have")
    try:
        value, found = _read_yaml(content.decode("utf-8"), truth_values)
    except UnicodeDecodeError as failure:
        raise error(f"{path} is not YAML: {failure}") from None
    except ParameterError as failure:
        raise error(f"{path} {failure}") from None
    return Cursor(value, Source(str(path), error, found if lines else {}))


def cursor_at(value: Any, name: str, error: type[ValueError] = ParameterError) -> Cursor:
    """Return a cursor at a value, with a name in place of a file's."""
    return Cursor(value, Source(name, error))
