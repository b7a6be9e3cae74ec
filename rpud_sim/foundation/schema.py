"""The reader of every YAML file: declarations of keys, from which values and errors follow.

A dataclass declares the keys of a mapping, and ``read`` returns it::

    @dataclasses.dataclass(frozen=True)
    class Pause:
        start: float = key(Quantity("s", "when it begins", 0.0, 1e6))
        reason: str = key(line, "")  # may be left out

    pauses = read(open_yaml("pauses.yaml"), list_of(Pause))

Each error names file, line, word, and the nearest right word or the allowed range.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias

from rpud_sim.foundation.quantities import Allowed, did_you_mean
from rpud_sim.foundation.yaml_files import YamlNode

# What reads a value: its allowed values, a dataclass of keys, readers by key, or a function.
Reader: TypeAlias = "Allowed | type[Any] | Mapping[str, Any] | Callable[[YamlNode], Any]"


def key(reader: Reader, default: Any = dataclasses.MISSING, name: str = "") -> Any:
    """Declare the key of a mapping, needed without a default; ``name`` where it differs."""
    metadata = {"reader": reader, "key": name}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=lambda: dict(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def read(node: YamlNode, reader: Reader) -> Any:
    """Return the value of a YAML node as a reader takes it, or raise an error with its place."""
    if isinstance(reader, Mapping):
        entries = node.mapping(reader)
        return {name: read(each, reader[name]) for name, each in entries.items()}
    if isinstance(reader, type):
        fields = keys_of(reader)
        entries = node.mapping(fields, [name for name, field in fields.items() if _needed(field)])
        values = {
            fields[name].name: read(each, fields[name].metadata["reader"])
            for name, each in entries.items()
        }
        with node.errors():
            return reader(**values)
    if isinstance(reader, Allowed):
        return node.check(reader)
    with node.errors():
        return reader(node)


def keys_of(kind: type[Any]) -> dict[str, dataclasses.Field[Any]]:
    """Return the fields of a dataclass that are keys of a file, by the key."""
    fields = (field for field in dataclasses.fields(kind) if "reader" in field.metadata)
    return {field.metadata["key"] or field.name: field for field in fields}


def _needed(field: dataclasses.Field[Any]) -> bool:
    return field.default is field.default_factory is dataclasses.MISSING


def list_of(
    reader: Reader, least: int = 0, most: int = 100_000, unique: bool = False
) -> Callable[[YamlNode], tuple[Any, ...]]:
    """Return the reader of a list."""

    def read_list(node: YamlNode) -> tuple[Any, ...]:
        entries = node.sequence()
        if not least <= len(entries) <= most:
            allowed = least if least == most else f"{least} to {most}"
            raise node.wrong(f"has {len(entries)} entries, not {allowed}")
        found = tuple(read(entry, reader) for entry in entries)
        if unique and len({repr(each) for each in found}) < len(found):
            raise node.wrong("has a value twice")
        return found

    return read_list


def named(reader: Reader) -> Callable[[YamlNode], dict[str, Any]]:
    """Return the reader of a mapping with names that the user chooses, each a word or a phrase."""

    def read_named(node: YamlNode) -> dict[str, Any]:
        entries = node.mapping().items()
        return {line(each, str(name)): read(each, reader) for name, each in entries}

    return read_named


def one_of(readers: Mapping[str, Reader]) -> Callable[[YamlNode], tuple[str, Any]]:
    """Return the reader of a mapping with one of several keys: the key and its value."""

    def read_one(node: YamlNode) -> tuple[str, Any]:
        if isinstance(node.value, Mapping) and len(node.value) == 1:
            [found] = read(node, readers).items()
            return found[0], found[1]
        raise node.wrong(f"is not a mapping with one of {', '.join(readers)}")

    return read_one


def name_in(known: Iterable[str], kind: str) -> Callable[[YamlNode], str]:
    """Return the reader of a name out of many, such as of a topic."""
    names = tuple(known)

    def read_name(node: YamlNode) -> str:
        if not (isinstance(node.value, str) and node.value in names):
            raise node.wrong(f"is not {kind}{did_you_mean(node.value, names)}")
        return node.value

    return read_name


def line(node: YamlNode, text: Any = None) -> str:
    """Return a text of one line: the value of a YAML node, or the name of its key."""
    text = node.value if text is None else text
    if not (isinstance(text, str) and text.strip() and text.isprintable()):
        raise node.wrong("is not a text of one line")
    return text


def raw_reader(node: YamlNode) -> Any:
    """Return the value of a YAML node, which something else checks."""
    return node.value


def node_reader(node: YamlNode) -> YamlNode:
    """Return the node itself, for what can be read only together with another key."""
    return node
