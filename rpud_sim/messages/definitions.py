"""Message definitions and type hashes from an ament installation, without ROS.

Without an installation, ``share/`` beside this file has the messages of this project: it links to
those in ``msg_defs``, and holds the fields of the standard messages that they need.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from rpud_sim.messages.definition_text import PRIMITIVES, TYPE_NAME, long_name
from rpud_sim.messages.errors import BagError

if TYPE_CHECKING:
    from mcap.records import Schema

    from rpud_sim.messages.cdr import Codec

_OWN_PLACE = Path(__file__).with_name("share")
_SEPARATOR = "=" * 80
_IDL = ("ros2idl", "omgidl")  # encodings of schemas
_FIELD_TYPE = re.compile(r"\s*([A-Za-z][\w/]*)")


def definition_of(schema: Schema) -> tuple[str | None, str]:
    """Return the ``ros2msg`` text of a schema, or None and the reason why it has none.

    Lines end as on Unix, whatever the machine that installed the definition.
    """
    if schema.encoding == "ros2msg":
        try:
            text = schema.data.decode()
        except UnicodeDecodeError as error:
            byte = schema.data[error.start]
            return None, f"the definition of its type is not UTF-8: it has the byte 0x{byte:02x}"
        text = text.replace("\ufeff", "")  # each file of a definition may begin with one
        return text.replace("\r\n", "\n").replace("\r", "\n"), ""
    if not schema.encoding or not schema.data.strip():
        return None, "the bag does not hold the definition of its type"
    kind = "IDL" if schema.encoding in _IDL else f"{schema.encoding!r:.40}"
    return None, f"the definition of its type is {kind}; only ros2msg, the text of a .msg, is read"


def full_name(schema: Schema) -> str:
    """Return the name of a schema's type; ``pkg/Type`` is short for ``pkg/msg/Type`` in ROS."""
    return long_name(schema.name) if schema.encoding in ("ros2msg", *_IDL) else schema.name


def find_definition(type_name: str) -> str:
    """Return the complete ``ros2msg`` definition of a type such as ``std_msgs/msg/Header``.

    It has all types that this one needs.
    """
    places = _places()
    parts = [_read(type_name, places, ".msg")]
    seen = {_short_name(type_name)}
    pending = list(_dependencies(parts[0], type_name))
    while pending:
        dependency = pending.pop(0)
        if dependency in seen:
            continue
        seen.add(dependency)
        text = _read(dependency, places, ".msg")
        parts.append(f"{_SEPARATOR}\nMSG: {dependency}\n{text}")
        pending.extend(_dependencies(text, dependency))
    return "\n".join(parts)


@cache
def installed_codec(type_name: str) -> Codec:
    """Return the codec of a type as it is installed here; making one takes long."""
    from rpud_sim.messages.cdr import Codec  # needs a library that a drill may lack

    return Codec(type_name, find_definition(type_name))


def find_type_hash(type_name: str) -> str:
    """Return the ``RIHS01_...`` hash of a message type.

    It comes from the installed description, or is calculated from the definition without one.
    """
    package, name = _split(type_name)
    places = _places()
    try:
        description = _read(type_name, places, ".json")
    except BagError:
        return installed_codec(type_name).type_hash
    try:
        for entry in json.loads(description)["type_hashes"]:
            if entry["type_name"] == f"{package}/msg/{name}":
                return str(entry["hash_string"])
    except (KeyError, TypeError, ValueError):
        pass
    raise BagError(f"the installed description of {type_name} has no type hash")


def _places() -> list[Path]:
    installed = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    return [*(Path(prefix) / "share" for prefix in installed), _OWN_PLACE]


def _split(type_name: str) -> tuple[str, str]:
    match = TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise BagError(f"message type is {type_name!r}; it must be of the form package/msg/Name")
    return match[1], match[2]


def _short_name(type_name: str) -> str:
    return "/".join(_split(type_name))


def _read(type_name: str, places: list[Path], suffix: str) -> str:
    package, name = _split(type_name)
    for place in places:
        file = place / package / "msg" / f"{name}{suffix}"
        if file.is_file():
            return file.read_text(encoding="utf-8")
    raise BagError(
        f"no definition of {type_name} under AMENT_PREFIX_PATH (share/{package}/msg/{name}{suffix})"
    )


def _dependencies(text: str, type_name: str) -> Iterator[str]:
    package, _ = _split(type_name)
    for line in text.splitlines():
        match = _FIELD_TYPE.match(line)
        if match is None or match[1] in PRIMITIVES:
            continue
        yield _short_name(match[1] if "/" in match[1] else f"{package}/{match[1]}")
