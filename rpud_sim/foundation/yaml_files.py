"""Reading of YAML from users: a value, or an error in one line."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from rpud_sim.foundation.quantities import ParameterError

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
    """Return the value of a text in YAML.

    Args:
        truth_values: whether words such as off are truth values or words.

    Raises:
        ParameterError: if it is not YAML, or has aliases or duplicate keys.
    """
    try:
        return yaml.load(text, _Loader if truth_values else _LoaderWithoutTruthValues)
    except (yaml.YAMLError, *_PYYAML_ERRORS) as error:
        raise ParameterError(f"is not YAML: {' '.join(str(error).split())}") from None


def yaml_lines(text: str) -> dict[tuple[str | int, ...], int]:
    """Return the line of each key and each entry of a text in YAML, from 1 on.

    Returns:
        lines by the keys and numbers that lead to the place.
    """
    found: dict[tuple[str | int, ...], int] = {}

    def visit(node: Any, path: tuple[str | int, ...]) -> None:
        found.setdefault(path, node.start_mark.line + 1)
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                inner = (*path, str(key.value))
                found[inner] = key.start_mark.line + 1
                visit(value, inner)
        elif isinstance(node, yaml.SequenceNode):
            for number, value in enumerate(node.value):
                visit(value, (*path, number))

    visit(yaml.compose(text, _Loader), ())
    return found


def read_yaml(path: str | Path, truth_values: bool = True) -> Any:
    """Return the value of a file in YAML.

    Raises:
        ParameterError: if it cannot be read, is too long or is not YAML; begins with its name.
    """
    return read_yaml_text(path, truth_values)[0]


def read_yaml_text(path: str | Path, truth_values: bool = True) -> tuple[Any, str]:
    """Return the value of a file in YAML, and its text."""
    try:
        with open(path, "rb") as file:
            content = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as error:  # a name with a null character is a ValueError
        reason = error.strerror if isinstance(error, OSError) else error
        raise ParameterError(f"{path}: {reason}") from None
    if len(content) > MOST_BYTES:
        raise ParameterError(f"{path} is longer than the {MOST_BYTES} bytes that it may have")
    try:
        text = content.decode("utf-8")
        return parse_yaml(text, truth_values), text
    except UnicodeDecodeError as error:
        raise ParameterError(f"{path} is not YAML: {error}") from None
    except ParameterError as error:
        raise ParameterError(f"{path} {error}") from None
