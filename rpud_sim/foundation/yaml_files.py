"""Reading of YAML from users: a value with its place, or an error in one line.

A reader opens a file and asks the cursor for what it expects. Each error names file and place::

    top = open_yaml(path, truth_values=False, error=FaultError)
    keys = top.mapping(("seed", "faults"), needed=("faults",))
    for entry in keys["faults"].sequence("entry {number}"):
        with entry.errors():  # of code that knows no file: FILE: entry 3: ...
            Fault(**{key: each.value for key, each in entry.mapping(_KEYS).items()})
    seed = top.get("seed", 0).check(SEED)  # FILE: seed = -1 is outside its range [0, 9]
    raise keys["faults"].refusal("{name} = {shown} is empty")  # FILE: faults = [] is empty

``where="{file}:{line}: "`` names the line. With ``dotted`` errors begin with the path of the value,
as in ``FILE: swept.free_mass.minimum: is missing``. ``cursor_at`` is for values without a file.
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


def parse_yaml(text: str, truth_values: bool = True) -> Any:
    """Return the value of a text in YAML; without ``truth_values`` off is a word."""
    try:
        return yaml.load(text, _Loader if truth_values else _LoaderWithoutTruthValues)
    except (yaml.YAMLError, *_PYYAML_ERRORS) as error:
        raise ParameterError(f"is not YAML: {' '.join(str(error).split())}") from None


def yaml_lines(text: str) -> dict[tuple[str | int, ...], int]:
    """Return the line of each key and entry, from 1 on, by the keys and numbers that lead there."""
    found: dict[tuple[str | int, ...], int] = {}

    def visit(node: Any, path: tuple[str | int, ...], line: int) -> None:
        found[path] = line
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                visit(value, (*path, str(key.value)), key.start_mark.line + 1)
        elif isinstance(node, yaml.SequenceNode):
            for number, value in enumerate(node.value):
                visit(value, (*path, number), value.start_mark.line + 1)

    if (whole := yaml.compose(text, _Loader)) is not None:
        visit(whole, (), whole.start_mark.line + 1)
    return found


Place = tuple[str | int, ...]


@dataclasses.dataclass(frozen=True)
class Source:
    """Origin of cursors, and the beginning of their errors."""

    file: str  # its name, or that of an option
    text: str = ""  # of the file, for the lines of places
    error: type[ValueError] = ParameterError  # class of the errors
    where: str = "{file}: "  # begins an error; may have the {line}
    dotted: bool = False  # whether errors go on with the path of the value

    def head(self, place: Place) -> str:
        """Return the beginning of an error about a place, or the nearest known one around it."""
        line = 1
        if "{line}" in self.where:
            lines = yaml_lines(self.text)
            while place and place not in lines:
                place = place[:-1]
            line = lines.get(place, 1)
        return self.where.format(file=self.file, line=line)


@dataclasses.dataclass(frozen=True)
class Cursor:
    """Value in YAML and its place; texts of refusals may use {name}, {shown} and {hint}."""

    value: Any
    source: Source
    name: str = ""  # its key, or with ``dotted`` the path to it
    label: str = ""  # of the entry around it, begins errors: such as ``entry 3``
    place: Place = ()  # keys and numbers that lead to it

    @property
    def prefix(self) -> str:
        """Beginning of an error: file, perhaps line, and label."""
        return self.source.head(self.place) + (f"{self.label}: " if self.label else "")

    def refusal(self, text: str, known: Iterable[str] = ()) -> ValueError:
        """Return an error in one line; ``known`` are the names for {names} and {hint}."""
        known = tuple(known)
        words = {"name": self.name, "shown": shown(self.value), "names": ", ".join(known)}
        hint = did_you_mean(self.value, known) if known else ""
        return self._error(text.format(**words, hint=hint))

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Context that gives file and label to errors of code that knows neither."""
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

    def sequence(
        self, label: str = "", *, other: str = "{name} = {shown} is not a list"
    ) -> list[Cursor]:
        """Return the entries of a list, or refuse what is none by the text ``other``.

        ``label`` is that of each entry, with its {number} from 1 on.
        """
        if not isinstance(self.value, list):
            raise self.refusal(other)
        outer = f"{self.label}: " if self.label else ""
        found = []
        for index, value in enumerate(self.value):
            name = f"{self.name}[{index}]"
            own = name if self.source.dotted else self.label
            if label:
                own = outer + label.format(number=index + 1)
            found.append(Cursor(value, self.source, name, own, (*self.place, index)))
        return found

    def check(self, allowed: Allowed) -> Any:
        """Return the value as a quantity, choice, flag or text takes it."""
        named = self.source.dotted and self.label == self.name
        with dataclasses.replace(self, label="" if named else self.label).errors():
            return allowed.check(self.name, self.value)

    def _at(self, key: Any, value: Any) -> Cursor:
        name, label = shown_name(key), self.label
        if self.source.dotted:
            name = label = f"{self.name}.{name}" if self.name else name
        return Cursor(value, self.source, name, label, (*self.place, str(key)))

    def _error(self, text: str) -> ValueError:
        error = self.source.error(self.prefix + text)
        vars(error)["place"] = self.place
        return error


def open_yaml(
    path: str | Path,
    *,
    truth_values: bool = True,
    error: type[ValueError] = ParameterError,
    where: str = "{file}: ",
    dotted: bool = False,
) -> Cursor:
    """Return a cursor at the value of a file; options as of ``Source`` and ``parse_yaml``."""
    try:
        with open(path, "rb") as file:
            content = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as failure:  # a name with a null character is a ValueError
        reason = failure.strerror if isinstance(failure, OSError) else failure
        raise error(f"{path}: {reason}") from None
    if len(content) > MOST_BYTES:
        raise error(f"{path} is longer than the {MOST_BYTES} bytes that it may have")
    try:
        text = content.decode("utf-8")
        value = parse_yaml(text, truth_values)
    except UnicodeDecodeError as failure:
        raise error(f"{path} is not YAML: {failure}") from None
    except ParameterError as failure:
        raise error(f"{path} {failure}") from None
    return Cursor(value, Source(str(path), text, error, where, dotted))


def cursor_at(value: Any, name: str, error: type[ValueError] = ParameterError) -> Cursor:
    """Return a cursor at a value, with a name in place of a file's."""
    return Cursor(value, Source(name, error=error))
