"""Names of files for topics, whatever a bag calls them."""

from __future__ import annotations

import hashlib
import re
from urllib.parse import quote

_ROS_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_LONGEST = 180  # bytes; file systems take 255


def file_stem(topic: str) -> str:
    """Name the file of a topic without its ending, as in ``rpud.contact_force``.

    No two topics have the same. What is no name in ROS gets ``topic-`` before it, and escapes
    for all that could be more than a name.
    """
    if _ROS_NAME.fullmatch(topic):
        stem = topic[1:].replace("/", ".")
    else:
        stem = "topic-" + quote(topic, safe="")
    if len(stem) > _LONGEST:
        stem = f"{stem[:_LONGEST]}-{hashlib.sha256(topic.encode()).hexdigest()[:16]}"
    return stem
