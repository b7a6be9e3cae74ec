"""Text of a ``ros2msg`` definition, as any tool writes it: its types and their fields."""

from __future__ import annotations

import re
from collections.abc import Iterator

_INTEGERS = [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
PRIMITIVES = {"bool", "byte", "char", "float32", "float64", "string", "wstring", *_INTEGERS}
# Line between the types of a definition: other tools draw it longer or shorter than ROS.
_PART = re.compile(r"^[ \t]*={2,}[ \t]*\n\s*(MSG|IDL):[ \t]*(\S*).*$", re.MULTILINE)
# Line of a definition that is not a comment: a type, and a name with perhaps a value.
_LINE = re.compile(
    r"([A-Za-z][\w/]*)((?:<=\d+)?(?:\[(?:<=)?\d*\])?)[ \t]+([A-Za-z]\w*)[ \t]*(.*)", re.ASCII
)
_DEFAULT = re.compile(r"[=\d.'\"\[#+-]|(true|false|nan|inf)\b", re.IGNORECASE)
_COMMENT = re.compile(r"(?:\"[^\"]*\"|'[^']*'|[^#\"'])*#+[ \t]*(.*)")
TYPE_NAME = re.compile(r"([A-Za-z]\w*)/(?:msg/)?([A-Za-z]\w*)")


def long_name(name: str) -> str:
    """Return ``pkg/msg/Type`` for a type that may be called ``pkg/Type``."""
    match = TYPE_NAME.fullmatch(name)
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
        yield long_name(name), text


def fields_of(type_name: str, text: str) -> Iterator[tuple[str, str, str]]:
    """Yield type, name and comment of each field in a type's own text; constants are none.

    A line ends where ROS ends it in a ``.msg``. A line that is not a field is a ValueError.
    """
    for number, line in enumerate(text.splitlines(), 1):
        plain = line.strip()
        if not plain or plain.startswith("#"):
            continue
        match = _LINE.fullmatch(plain)
        if match is None or (match[4] and match[1] != "string" and not _DEFAULT.match(match[4])):
            raise ValueError(f"line {number} of {type_name:.80} is not a field: {line:.80}")
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
        if name not in PRIMITIVES:
            name = long_name(name if "/" in name else f"{package}/{name}")
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
