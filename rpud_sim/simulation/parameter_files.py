"""Reading of ROS parameter files and of ``name=value``, without ROS."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, shown
from rpud_sim.foundation.yaml_files import open_yaml, parse_yaml


def read_parameter_file(path: str | Path) -> dict[str, Any]:
    """Return the parameters of a ROS file: those below ``/**``, then those of its nodes."""
    nodes = open_yaml(path).file_mapping("a ROS parameter file")
    found: dict[str, Any] = {}
    for _, node in sorted(nodes.items(), key=lambda item: str(item[0]) != "/**"):
        section = node.value if isinstance(node.value, Mapping) else {}
        values = section.get("ros__parameters")
        if not isinstance(values, Mapping):
            raise node.refusal("{name} has no mapping named ros__parameters")
        found.update({str(name): value for name, value in values.items()})
    return found


def parse_assignment(text: str) -> tuple[str, Any]:
    """Return name and value of ``name=value``; the value is read as YAML."""
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise ParameterError(f"{shown(text)} is not of the form name=value")
    try:
        return name, parse_yaml(value)
    except ParameterError:
        return name, value
