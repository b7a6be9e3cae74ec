"""Configuration files: ROS parameter files in YAML, read without ROS."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from rpud_sim.model.parameters import NAMES, ParameterError, Parameters, preset

# Parameters of the drill node that are not the model's; they may stand in the same file.
NODE_NAMES = (
    "drive_enabled",
    "publish_clock",
    "nominal_voltage",
    "telemetry_rate",
    "sample_rate",
    "block_duration",
)


class _Loader(yaml.SafeLoader):
    """YAML in which 1e-3 and 1.96e11 are numbers, as in YAML 1.2 and for ROS."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Refuse a key that stands twice: the first value would be lost silently."""
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    raise yaml.MarkedYAMLError(
                        None, None, f"{key.value} is given twice", key.start_mark
                    )
                seen.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def read_yaml(path: str | Path) -> Any:
    """Return the content of a YAML file.

    Raises:
        ParameterError: if the file cannot be read or is not YAML.
    """
    try:
        return yaml.load(Path(path).read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise ParameterError(f"{path}: {error.strerror}") from None
    # PyYAML gives values that look like a number or a date and are none to Python as they are.
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ParameterError(f"{path} is not YAML: {' '.join(str(error).split())}") from None


def read_parameter_file(path: str | Path) -> dict[str, Any]:
    """Return the parameters of a ROS parameter file: those below ``/**``, then those of its nodes.

    Raises:
        ParameterError: if the file cannot be read or is no parameter file.
    """
    content = read_yaml(path)
    if not isinstance(content, Mapping):
        raise ParameterError(f"{path} is not a ROS parameter file: it holds no mapping")
    found: dict[str, Any] = {}
    for node, section in sorted(content.items(), key=lambda item: str(item[0]) != "/**"):
        values = section.get("ros__parameters") if isinstance(section, Mapping) else None
        if not isinstance(values, Mapping):
            raise ParameterError(f"{path}: {node} has no mapping named ros__parameters")
        found.update({str(name): value for name, value in values.items()})
    return found


def parse_assignment(text: str) -> tuple[str, Any]:
    """Return name and value of ``name=value``; the value is read as YAML does.

    Raises:
        ParameterError: if the text has another form.
    """
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise ParameterError(f"{text!r} is not of the form name=value")
    try:
        parsed = yaml.load(value, _Loader)
    except yaml.YAMLError:
        parsed = value
    return name, parsed


def to_parameters(values: Mapping[str, Any]) -> Parameters:
    """Return the model's parameters: the regime's preset with the given values.

    Args:
        values: by name; ``regime`` chooses the preset, drilling if it is not given. The node's own
            are passed over.

    Raises:
        ParameterError: if a name is unknown or a value is outside its range.
    """
    known = {name: value for name, value in values.items() if name not in NODE_NAMES}
    for name in known:
        if name not in NAMES:
            raise ParameterError(
                f"{name} is not a parameter; known are {', '.join((*NAMES, *NODE_NAMES))}"
            )
    return preset(known.pop("regime", "drilling")).replace(**known)
