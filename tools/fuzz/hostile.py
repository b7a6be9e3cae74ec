"""Hostile values: what no careful client sends. All are drawn from a seeded `random.Random`."""

from __future__ import annotations

import math
import random
import re
import struct
import sys
from collections.abc import Collection, Mapping
from typing import Any

NUMBERS = (
    *(0.0, -0.0, 1.0, -1.0, 0.5, 5e-324, -5e-324, 2.2250738585072014e-308, sys.float_info.epsilon),
    *(math.nan, math.inf, -math.inf, sys.float_info.max, -sys.float_info.max, 1e308, -1e-308),
    *(1e3, math.nextafter(1e3, 2e3), 1e-9, 1e9, 1e18, 2.0**53 + 2.0, 1e22),
    *(0.9, 10.0, 100.0, 900.0, 2e3, 16e3),  # what a drill takes
)
WORDS = (
    *("", " ", "free", "drilling", "FREE", "none", "null", "true", "nan", "inf", "-", "~", "0"),
    *("\x00", "a\x00b", "\n", "two\nlines", "\r", "\t", "\x1b[31m", "\u202e", "\ufeff", "\ufffd"),
    *("ä", "日本", "\U0001f4a5", "é" * 50, "%s%n%d", "{0.__class__}", "$(reboot)", "1"),
    *("../../etc/passwd", "/dev/zero", "/", ".", "a" * 10_000, "é" * 4_000),
    *("'", '"', "\\", "<!--", "*", "&a", "!!int", ".inf", "1e400", "9" * 80, "[1]", "{a: b}"),
)


def number(drawn: random.Random) -> float:
    """A float of any kind: special, of any bit pattern, or near what is allowed."""
    any_bits = struct.unpack("<d", drawn.randbytes(8))[0]
    near = drawn.uniform(-2.0, 2.0) * 10.0 ** drawn.randrange(-12, 13)
    return drawn.choice((drawn.choice(NUMBERS), drawn.choice(NUMBERS), any_bits, near))


def whole(drawn: random.Random, bits: int, signed: bool = False) -> int:
    """An integer that a field of so many bits can hold."""
    least, most = -(1 << (bits - 1)) if signed else 0, (1 << (bits - signed)) - 1
    few = drawn.randrange(9)
    return min(drawn.choice((least, most, most - 1, few, few, drawn.getrandbits(bits))), most)


def text(drawn: random.Random) -> str:
    """A text that is odd, long, empty or unprintable; ROS takes no surrogates."""
    if drawn.random() < 0.7:
        return drawn.choice(WORDS)
    return "".join(chr(drawn.randrange(1, 0xD800)) for _ in range(drawn.randrange(1, 40)))


def fill(drawn: random.Random, message: Any, known: Mapping[str, Collection[Any]]) -> Any:
    """Give every field of a ROS message a value of its type, and return the message.

    Fields whose names are ``known`` get one of these values; texts among them are damaged at times.
    """
    for field, described in message.get_fields_and_field_types().items():
        kind = described.removeprefix("sequence<").removesuffix(">")
        count = 1 if kind == described else drawn.choice((0, 1, 1, 1, 2, 5))
        values = [_value(drawn, kind, tuple(known.get(field, ())), known) for _ in range(count)]
        setattr(message, field, values[0] if kind == described else values)
    return message


def _value(drawn: random.Random, kind: str, choices: tuple[Any, ...], known: Any) -> Any:
    if "/" in kind:
        from rpud_sim.ros.graph import message_class

        return fill(drawn, message_class(kind.replace("/", "/msg/"))(), known)
    if choices:
        chosen = drawn.choice(choices)
        odd = kind == "string" and drawn.random() < 0.25
        return (
            drawn.choice((text(drawn), chosen.upper(), chosen[:-1], chosen * 2)) if odd else chosen
        )
    if kind in ("boolean", "octet", "string"):
        return {"boolean": drawn.random() < 0.5, "octet": drawn.randbytes(1)}.get(kind, text(drawn))
    bits = re.search(r"\d+", kind)
    return whole(drawn, int(bits[0]), not kind.startswith("u")) if bits else number(drawn)


def damaged(drawn: random.Random, content: bytes) -> bytes:
    """Remove, overwrite, repeat or replace a few parts of bytes."""
    data = bytearray(content)
    for _ in range(drawn.choice([1, 1, 1, 2, 5, 20])):
        at, source = (drawn.randrange(len(data) + 1) for _ in range(2))
        length, size = drawn.choice([1, 1, 4, 9, 50, 400]), drawn.choice([1, 2, 4, 8])
        new, end = drawn.choice(
            [
                *((b"", len(data)), (b"", at + length), (drawn.randbytes(length), at + length)),
                (data[source : source + length], at),
                (whole(drawn, 8 * size).to_bytes(size, "little"), at + size),
            ]
        )
        data[at:end] = new
    return bytes(data)


def odd_text(drawn: random.Random, content: str) -> str:
    """Replace, repeat or remove a few words of a text, or the spaces between."""
    parts = re.split(r"(\s+)", content)
    for _ in range(drawn.choice([1, 1, 2, 4])):
        place = drawn.randrange(len(parts) + 1)
        word = parts[place : place + 1]
        parts[place : place + 1] = drawn.choice([[], word * 2, [drawn.choice(WORDS)]])
    return "".join(parts)
