"""Recorded messages of an earlier version of a type, as messages of the installed version."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np

from rpud_sim.bag import BagError, BagFormatError, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_type_hash
from rpud_sim.ros.types import UnknownTypeError, message_class

# Type of the elements of a field, such as ``sequence<rpud_msgs/Fault>``.
_ELEMENT = re.compile(r"(?:.*<)?(\w+)/(\w+).*")


def conversion(summary: TopicSummary, installed: Any) -> Callable[[bytes], Any] | None:
    """Return what makes messages of an installed class of a topic's bytes; None if they are such.

    A subscriber drops a message that ends early. Fields that the recorded version lacks get their
    default. One with a field that the installed version lacks is an UnknownTypeError.
    """
    topic = summary.topic
    try:
        same = topic.type_hash in ("", find_type_hash(topic.type))
    except BagError:  # the type is no part of an installation
        return None
    if same or summary.definition is None:
        return None
    try:
        codec = Codec(topic.type, summary.definition)
    except BagFormatError as error:
        raise UnknownTypeError(str(error)) from error
    recorded = {name for name, _, _ in codec.fields(topic.type)}
    if gone := recorded - installed.get_fields_and_field_types().keys():
        raise UnknownTypeError(f"the installed {topic.type} has no {', '.join(sorted(gone))}")

    def converted(data: bytes) -> Any:
        try:
            return _filled(installed(), codec.decode(data))
        except (AssertionError, AttributeError, BagFormatError, TypeError, ValueError):
            return data  # a damaged one goes out as it is

    return converted


def _filled(message: Any, values: Any) -> Any:
    for name, kind in message.get_fields_and_field_types().items():
        if not hasattr(values, name):
            continue
        value = getattr(values, name)
        if "/" not in kind:
            value = value.tolist() if isinstance(value, np.ndarray) else value
        elif isinstance(value, list):
            element = message_class(_ELEMENT.sub(r"\1/msg/\2", kind))
            value = [_filled(element(), each) for each in value]
        else:
            value = _filled(getattr(message, name), value)
        setattr(message, name, value)
    return message
