"""Values of YAML from users with their place in the file, for errors in one line.

Each error names file and line, such as ``FILE:3: seed = -1 is outside its range [0, 9]``. Values
that come from elsewhere, as of ``yaml_node``, have no lines, and errors name their path:
``FILE: faults[0].onset = -1 s is ...``.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping, Set
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from rpud_sim.foundation.quantities import (
    Allowed,
    Flag,
    ParameterError,
    did_you_mean,
    short_name,
    short_repr,
)
from rpud_sim.foundation.terminal import error_text
from rpud_sim.foundation.user_files import named_errors, read_file

# Files for this are written by hand. A longer file is something else and takes seconds to read.
MOST_BYTES = 100_000
_DEEPEST = 50  # levels of mappings and lists


class _Loader(yaml.SafeLoader):
    """Loader of the YAML of ROS: 1e-3 is a number, 1:30, 1_000 and 0b11 are none.

    Only true and false are truth values. It rejects aliases, as ROS does, because a short file
    with them can become very large, and duplicate keys.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.composer.ComposerError(
                None, None, "aliases are not allowed here", self.peek_event().start_mark
            )
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(
                    None, None, "a key is a list or a mapping", key.start_mark
                )
        mapping = super().construct_mapping(node, deep)
        if len(mapping) < len(node.value):
            raise yaml.constructor.ConstructorError(
                None, None, "a key occurs twice in one mapping", node.start_mark
            )
        return mapping


def _reject_tag(loader: _Loader, node: Any) -> Any:
    raise yaml.constructor.ConstructorError(
        None, None, f"the tag {node.tag!r:.80} means nothing here", node.start_mark
    )


_Loader.add_constructor(None, _reject_tag)
_BOOL, _INT, _FLOAT = (f"tag:yaml.org,2002:{name}" for name in ("bool", "int", "float"))
_Loader.yaml_implicit_resolvers = {
    first: [resolver for resolver in resolvers if resolver[0] not in (_BOOL, _INT, _FLOAT)]
    for first, resolvers in _Loader.yaml_implicit_resolvers.items()
}
_NUMBER_BEGINS = "-+.0123456789"
for _tag, _pattern, _first in (
    (_BOOL, r"(true|True|TRUE|false|False|FALSE)$", "tTfF"),
    (_INT, r"[-+]?(0x[0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)$", _NUMBER_BEGINS),
    (_FLOAT, r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?$", _NUMBER_BEGINS),
    (_FLOAT, r"([-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))$", _NUMBER_BEGINS),
):
    _Loader.add_implicit_resolver(_tag, re.compile(_pattern), list(_first))
# Words that are truth values where one is expected; elsewhere off is a kind of fault.
_TRUTH_WORDS = {"yes": True, "y": True, "on": True, "no": False, "n": False, "off": False}

# PyYAML raises these as well: for a text that does not fit its tag, or is nested too deeply.
_PYYAML_ERRORS = (ValueError, LookupError, AttributeError, TypeError, OverflowError, RecursionError)

Place: TypeAlias = tuple[str | int, ...]
Lines: TypeAlias = Mapping[Place, int]


def _merged(node: Any, place: Place, repeated: set[Place]) -> None:
    """Merge the values of duplicate keys, as ROS does: the later of two values counts.

    Mappings become one. The places of other values that come twice are added to ``repeated``.
    """
    if not isinstance(node, yaml.MappingNode):
        return
    found: dict[str, tuple[Any, Any]] = {}
    for key, value in node.value:
        name = str(key.value)
        before = found.get(name, (key, None))[1]
        if isinstance(before, yaml.MappingNode) and isinstance(value, yaml.MappingNode):
            before.value += value.value
            continue
        if before is not None:
            repeated.add((*place, name))
        found[name] = (key, value)
    node.value = list(found.values())
    for name, (_, value) in found.items():
        if len(place) <= _DEEPEST:  # deeper ones are rejected
            _merged(value, (*place, name), repeated)


def _read_yaml(text: str, repeated: set[Place] | None = None) -> tuple[Any, Lines]:
    """Return the value of a text, and the line of each key and entry, from 1 on.

    With ``repeated`` duplicate keys are merged, and their places added to it.
    """
    lines: dict[Place, int] = {}

    def visit(node: Any, place: Place, line: int) -> None:
        lines[place] = line
        if len(place) > _DEEPEST:
            raise ParameterError(f"nested deeper than {_DEEPEST} levels")
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                visit(value, (*place, str(key.value)), key.start_mark.line + 1)
        elif isinstance(node, yaml.SequenceNode):
            for number, value in enumerate(node.value):
                visit(value, (*place, number), value.start_mark.line + 1)

    try:
        loader = _Loader(text)
        if (whole := loader.get_single_node()) is None:
            return None, {(): 1}
        if repeated is not None:
            _merged(whole, (), repeated)
        visit(whole, (), whole.start_mark.line + 1)
        return loader.construct_document(whole), lines
    except (yaml.YAMLError, *_PYYAML_ERRORS) as error:
        raise ParameterError(f"is not YAML: {error_text(error)}") from None


def parse_yaml(text: str) -> Any:
    """Return the value of a text in YAML."""
    return _read_yaml(text)[0]


def truth_value(value: Any) -> Any:
    """Return the truth value of a word such as on; anything else as it is."""
    return _TRUTH_WORDS.get(value.lower(), value) if isinstance(value, str) else value


@dataclasses.dataclass(frozen=True)
class YamlNode:
    """Value in YAML and its place."""

    value: Any
    file: str  # name of the file or of an option
    lines: Lines = dataclasses.field(default_factory=dict)  # lines of places; empty if unknown
    name: str = ""  # its key, or the path to it where lines are unknown
    place: Place = ()  # keys and numbers that lead to it
    repeated: Set[Place] = frozenset()  # places of keys that occur twice, of which the later counts

    @property
    def prefix(self) -> str:
        """Beginning of an error: file, and the nearest known line around the place, or its path."""
        if not self.lines:
            return f"{self.file}: {self.name}: " if self.name else f"{self.file}: "
        known = (self.place[:size] for size in range(len(self.place), -1, -1))
        return f"{self.file}:{next(self.lines[place] for place in known if place in self.lines)}: "

    def error(self, text: str) -> ParameterError:
        """Return an error in one line."""
        error = ParameterError(self.prefix + text)
        vars(error)["place"] = self.place
        return error

    def wrong(self, reason: str) -> ParameterError:
        """Return the error that this value is something else."""
        unnamed = dataclasses.replace(self, name="")
        return unnamed.error(f"{self.name} = {short_repr(self.value)} {reason}")

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Context that gives errors of other code the place of the key that they name first."""
        try:
            yield
        except ParameterError as error:
            if "place" in vars(error):
                raise
            place = (*self.place, *re.findall(r"\w+", str(error))[:1])
            raise dataclasses.replace(self, place=place).error(str(error)) from None

    def mapping(
        self, known: Iterable[str] | None = None, needed: Iterable[str] = ()
    ) -> dict[Any, YamlNode]:
        """Return the values of a mapping by key; it may have ``known`` keys, None for any."""
        if not isinstance(self.value, Mapping):
            if not self.name:
                raise self.error("the file is not a mapping of keys and values")
            raise self.wrong("is not a mapping of keys and values")
        found = {key: self._at(key, value) for key, value in self.value.items()}
        if known is not None:
            known = tuple(known)
            for key, each in found.items():
                if not (isinstance(key, str) and key in known):
                    named = dataclasses.replace(each, name=self.name)
                    raise named.error(
                        f"{short_repr(key)} is not a key here{did_you_mean(key, known)}"
                    )
        for key in needed:
            if key not in found:
                raise self.error(f"{key} is missing")
        return found

    def get(self, key: str, default: Any = None) -> YamlNode:
        return self._at(key, self.value.get(key, default))

    def sequence(self) -> list[YamlNode]:
        """Return the entries of a list."""
        if not isinstance(self.value, list):
            raise self.wrong("is not a list")
        return [
            dataclasses.replace(
                self, value=value, name=f"{self.name}[{index}]", place=(*self.place, index)
            )
            for index, value in enumerate(self.value)
        ]

    def check(self, allowed: Allowed) -> Any:
        """Return the value as a quantity, choice, flag or text takes it."""
        value = truth_value(self.value) if isinstance(allowed, Flag) else self.value
        with dataclasses.replace(self, name="").errors():
            return allowed.check(self.name, value)

    def _at(self, key: Any, value: Any) -> YamlNode:
        name = short_name(key)
        if self.name and not self.lines:
            name = f"{self.name}.{name}"
        return dataclasses.replace(self, value=value, name=name, place=(*self.place, str(key)))


def open_yaml(path: str | Path, *, merge: bool = False) -> YamlNode:
    """Return the YAML node of a file's value; ``merge`` accepts duplicate keys, as ROS does."""
    repeated: set[Place] | None = set() if merge else None
    with named_errors(path, ParameterError):
        content = read_file(path, MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ParameterError(f"{path} is longer than the {MOST_BYTES} bytes that it may have")
    try:
        value, lines = _read_yaml(content.decode("utf-8"), repeated)
    except UnicodeDecodeError as failure:
        line = content.count(b"\n", 0, failure.start) + 1
        reason = f"line {line}: the byte 0x{content[failure.start]:02x} is not UTF-8"
        raise ParameterError(f"{path} is not YAML: {reason}") from None
    except ParameterError as failure:
        raise ParameterError(f"{path} {failure}") from None
    return YamlNode(value, str(path), lines, repeated=repeated or frozenset())


def yaml_node(value: Any, name: str) -> YamlNode:
    """Return the YAML node of a value, with a name instead of a file's."""
    return YamlNode(value, name)
