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
    *(1e3, 1e3 + 1e-10, math.nextafter(1e3, 2e3), 1e-9, 1e9, 1e18, 2.0**53 + 2.0, 1e22),
)
PLAIN = (0.0, 0.5, 0.9, 10.0, 100.0, 900.0, 2e3, 16e3)  # what a drill takes
WORDS = (
    *("", " ", "free", "drilling", "FREE", "none", "null", "true", "nan", "inf", "-", "~", "0"),
    *("\x00", "a\x00b", "\n", "two\nlines", "\r", "\t", "\x1b[31m", "\u202e", "\ufeff", "\ufffd"),
    *("ä", "日本", "\U0001f4a5", "é" * 50, "%s%n%d", "{0.__class__}", "$(reboot)", "1"),
    *("../../etc/passwd", "/dev/zero", "/", ".", "a" * 10_000, "é" * 4_000),
    *("'", '"', "\\", "<!--", "*", "&a", "!!int"),
)
WHOLES = (0, 1, 2, 3, 4, 5, 7, 8, 16, 64, 101, 127, 128, 200, 254, 255)


def number(drawn: random.Random) -> float:
    """A float of any kind: special, of any bit pattern, or near what is allowed."""
    choice = drawn.randrange(4)
    if choice == 0:
        return drawn.choice(NUMBERS)
    if choice == 1:
        return struct.unpack("<d", drawn.randbytes(8))[0]
    if choice == 2:
        return drawn.uniform(-2.0, 2.0) * 10.0 ** drawn.randrange(-12, 13)
    return drawn.choice((*PLAIN, -drawn.random()))


def whole(drawn: random.Random, bits: int, signed: bool = False) -> int:
    """An integer that a field of so many bits can hold."""
    least, most = -(1 << (bits - 1)) if signed else 0, (1 << (bits - signed)) - 1
    chosen = drawn.choice((least, most, most - 1, drawn.choice(WHOLES), drawn.getrandbits(bits)))
    return min(max(chosen, least), most)


def text(drawn: random.Random) -> str:
    """A text that is odd, long, empty or unprintable; ROS takes no surrogates."""
    if drawn.random() < 0.7:
        return drawn.choice(WORDS)
    return "".join(chr(drawn.randrange(1, 0xD800)) for _ in range(drawn.randrange(1, 40)))


def name(drawn: random.Random, names: Collection[str]) -> str:
    """One of the names, sometimes damaged, or any text."""
    known = drawn.choice(tuple(names))
    odd = (known.upper(), known + " ", known[:-1], known * 2, f"/{known}")
    return drawn.choice((text(drawn), drawn.choice(odd), *[known] * 6))


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
    if kind == "string":
        return name(drawn, choices) if choices else text(drawn)
    if choices:
        return drawn.choice(choices)
    if kind in ("boolean", "octet"):
        return drawn.random() < 0.5 if kind == "boolean" else drawn.randbytes(1)
    bits = re.search(r"\d+", kind)
    return whole(drawn, int(bits[0]), not kind.startswith("u")) if bits else number(drawn)


def damaged(drawn: random.Random, content: bytes) -> bytes:
    """Damage bytes in a few places."""
    data = bytearray(content)
    for _ in range(drawn.choice([1, 1, 1, 2, 5, 20])):
        at, length = drawn.randrange(len(data) + 1), drawn.choice([1, 1, 4, 9, 50, 400])
        source, size = drawn.randrange(len(data) + 1), drawn.choice([1, 2, 4, 8])
        new, end = drawn.choice(
            [
                (b"", len(data)),
                (b"", at + length),
                (drawn.randbytes(length), at + length),
                (data[source : source + length], at),
                (whole(drawn, 8 * size).to_bytes(size, "little"), at + size),
                (bytes(byte ^ 1 << drawn.randrange(8) for byte in data[at : at + 1]), at + 1),
            ]
        )
        data[at:end] = new
    return bytes(data)


def odd_text(drawn: random.Random, content: str, words: Collection[str] = WORDS) -> str:
    """Change a few words or lines of a text."""
    for _ in range(drawn.choice([1, 1, 2, 4])):
        kind, lines = drawn.randrange(4), content.split("\n")
        at, place = drawn.randrange(len(lines)), drawn.randrange(len(content) + 1)
        word = drawn.choice(tuple(words))
        if kind == 0:
            lines.insert(at, drawn.choice(lines))
        elif kind == 1:
            del lines[at]
        elif kind == 2:
            inner = lines[at].split(" ")
            inner[drawn.randrange(len(inner))] = word
            lines[at] = " ".join(inner)
        else:
            lines = [content[:place] + word + content[place + drawn.randrange(4) :]]
        content = "\n".join(lines)
    return content
