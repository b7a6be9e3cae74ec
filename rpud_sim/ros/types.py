"""Message classes by the names of their types."""

from __future__ import annotations

import importlib
import re
from typing import Any

from rclpy.type_support import check_for_type_support

_TYPE_NAME = re.compile(r"([A-Za-z]\w*)/([a-z]+)/([A-Za-z]\w*)")


class UnknownTypeError(Exception):
    """A message type is not installed."""


def message_class(type_name: str) -> Any:
    """Import the class of a message type such as `std_msgs/msg/String`.

    Raises UnknownTypeError where it is not installed.
    """
    match = _TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise UnknownTypeError(f"type {type_name!r} is not of the form package/msg/Name")
    package, kind, name = match.groups()
    try:
        message = getattr(importlib.import_module(f"{package}.{kind}"), name)
        check_for_type_support(message)
    except Exception as error:
        # Whatever a foreign package raises while it is loaded, the type cannot be had.
        raise UnknownTypeError(
            f"type {type_name} is not installed here ({type(error).__name__}: {error})"
        ) from error
    return message
