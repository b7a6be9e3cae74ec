"""Message definitions and type hashes from an ament installation, without ROS.

Without an installation, ``share/`` beside this file has the messages of this project: it links to
those in ``msg_defs``, and holds the fields of the standard messages that they need.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rpud_sim.bag.errors import DefinitionNotFoundError

if TYPE_CHECKING:
    from mcap.records import Schema

_OWN_PLACE = Path(__file__).with_name("share")
_SEPARATOR = "=" * 80
_INTEGERS = [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
_PRIMITIVES = {"bool", "byte", "char", "float32", "float64", "string", "wstring", *_INTEGERS}
# Line between the types of a definition: other tools draw it longer or shorter than ROS.
_PART = re.compile(r"^[ \t]*={2,}[ \t]*\n\s*(MSG|IDL):[ \t]*(\S*).*$", re.MULTILINE)
# Line of a definition that is no comment: a type, and a name with perhaps a value.
_LINE = re.compile(
    r"([A-Za-z][\w/]*)((?:<=\d+)?(?:\[(?:<=)?\d*\])?)[ \t]+([A-Za-z]\w*)[ \t]*(.*)", re.ASCII
)
_DEFAULT = re.compile(r"[=\d.'\"\[#+-]|(true|false|nan|inf)\b", re.IGNORECASE)
_COMMENT = re.compile(r"(?:\"[^\"]*\"|'[^']*'|[^#\"'])*#+[ \t]*(.*)")
_IDL = ("ros2idl", "omgidl")  # encodings of schemas
_TYPE_NAME = re.compile(r"([A-Za-z]\w*)/(?:msg/)?([A-Za-z]\w*)")
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
    return _full_name(schema.name) if schema.encoding in ("ros2msg", *_IDL) else schema.name


def _full_name(name: str) -> str:
    match = _TYPE_NAME.fullmatch(name)
    return f"{match[1]}/msg/{match[2]}" if match else name


def parts_of(type_name: str, definition: str) -> Iterator[tuple[str, str]]:
    """Yield the full name and the text of each type in a ``ros2msg`` definition, its own first.

    A part that is IDL is a ValueError.
    """
    first, *others = _PART.split(definition)
    yield type_name, first
    for kind, name, text in zip(others[::3], others[1::3], others[2::3], strict=True):
        if kind == "IDL":
            raise ValueError("a part of it is IDL; only ros2msg, the text of a .msg, is read")
        yield _full_name(name), text


def fields_of(type_name: str, text: str) -> Iterator[tuple[str, str, str]]:
    """Yield type, name and comment of each field in a type's own text; constants are none.

    Lines end where those of a ``.msg`` do in ROS. Another line is a ValueError.
    """
    for number, line in enumerate(text.splitlines(), 1):
        plain = line.strip()
        if not plain or plain.startswith("#"):
            continue
        match = _LINE.fullmatch(plain)
        if match is None or (match[4] and match[1] != "string" and not _DEFAULT.match(match[4])):
            raise ValueError(f"line {number} of {type_name:.80} is no field: {line:.80}")
        if not match[4].startswith("="):
            comment = _COMMENT.match(match[4])
            yield match[1] + match[2], match[3], comment[1] if comment else ""


def structure_of(type_name: str, definition: str) -> tuple[str, ...]:
    """Return a type's name and all fields of its definition: equal for messages of equal bytes.

    Tools write types in another order, and names, comments and constants as they like. What is
    not understood stays as it is.
    """

    def resolved(kind: str, package: str) -> str:
        name, *rest = re.split(r"(?=[<\[])", kind, maxsplit=1)
        if name not in _PRIMITIVES:
            name = _full_name(name if "/" in name else f"{package}/{name}")
        return "".join([name, *rest])

    found = []
    try:
        for name, text in parts_of(type_name, definition):
            package = name.partition("/")[0]
            fields = [f"{resolved(kind, package)} {own}" for kind, own, _ in fields_of(name, text)]
            found.append(f"{name}: {', '.join(fields)}")
    except ValueError:
        return type_name, definition
    return type_name, *sorted(found)


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


def find_type_hash(type_name: str) -> str:
    """Return the ``RIHS01_...`` hash of a message type.

    It comes from the installed description, or is calculated from the definition without one.
    """
    package, name = _split(type_name)
    places = _places()
    try:
        description = _read(type_name, places, ".json")
    except DefinitionNotFoundError:
        from rpud_sim.bag.cdr import Codec

        return Codec(type_name, find_definition(type_name)).type_hash
    try:
        for entry in json.loads(description)["type_hashes"]:
            if entry["type_name"] == f"{package}/msg/{name}":
                return str(entry["hash_string"])
    except (KeyError, TypeError, ValueError):
        pass
    raise DefinitionNotFoundError(f"the installed description of {type_name} has no type hash")


def _places() -> list[Path]:
    installed = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    return [*(Path(prefix) / "share" for prefix in installed), _OWN_PLACE]


def _split(type_name: str) -> tuple[str, str]:
    match = _TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise DefinitionNotFoundError(
            f"message type is {type_name!r}; it must be of the form package/msg/Name"
        )
    return match[1], match[2]


def _short_name(type_name: str) -> str:
    return "/".join(_split(type_name))


def _read(type_name: str, places: list[Path], suffix: str) -> str:
    package, name = _split(type_name)
    for place in places:
        file = place / package / "msg" / f"{name}{suffix}"
        if file.is_file():
            return file.read_text(encoding="utf-8")
    raise DefinitionNotFoundError(
        f"no definition of {type_name} under AMENT_PREFIX_PATH (share/{package}/msg/{name}{suffix})"
    )


def _dependencies(text: str, type_name: str) -> Iterator[str]:
    package, _ = _split(type_name)
    for line in text.splitlines():
        match = _FIELD_TYPE.match(line)
        if match is None or match[1] in _PRIMITIVES:
            continue
        yield _short_name(match[1] if "/" in match[1] else f"{package}/{match[1]}")
