"""Message classes by the names of their types, and their members."""

from __future__ import annotations

import importlib
import re
from typing import Any

from rclpy.type_support import check_for_type_support

from rpud_sim.bag.encoder import CODES, Members, Sequence

_TYPE_NAME = re.compile(r"([A-Za-z]\w*)/([a-z]+)/([A-Za-z]\w*)")
_SEQUENCE = re.compile(r"sequence<([^,]+)>")


class UnknownTypeError(Exception):
    """Message type that is not installed."""


def message_class(type_name: str) -> Any:
    """Import the class of a message type such as ``std_msgs/msg/String``."""
    match = _TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise UnknownTypeError(f"type {type_name!r} is not of the form package/msg/Name")
    package, kind, name = match.groups()
    try:
        message = getattr(importlib.import_module(f"{package}.{kind}"), name)
        check_for_type_support(message)
    except Exception as error:
        # A foreign package may raise anything while it is loaded.
        raise UnknownTypeError(
            f"type {type_name} is not installed here ({type(error).__name__}: {error})"
        ) from error
    return message


def members_of(message: Any) -> Members:
    """Return the members of a message class, as an encoder needs them.

    A type with others than numbers, texts, messages and their sequences is an UnknownTypeError.
    """
    members = message.get_fields_and_field_types().items()
    return Members(tuple((name, _member(described)) for name, described in members))


def _member(described: str) -> Any:
    if described in CODES:
        return CODES[described]
    sequence = _SEQUENCE.fullmatch(described)
    if sequence is not None:
        return Sequence(_member(sequence[1]))
    return members_of(message_class(described.replace("/", "/msg/")))
