"""Hostile values: what no careful client sends. All are drawn from a seeded `random.Random`."""

from __future__ import annotations

import math
import random
import re
import struct
import sys
from collections.abc import Collection, Mapping
from typing import Any

from rpud_sim.ros.graph import message_class

NUMBERS = (
    *(0.0, -0.0, 1.0, -1.0, 0.5, 5e-324, -5e-324, 2.2250738585072014e-308, sys.float_info.epsilon),
    *(math.nan, math.inf, -math.inf, sys.float_info.max, -sys.float_info.max, 1e308, -1e-308),
    *(10.0, 100.0, 900.0, 16e3, 2e3, 0.9),  # what a drill takes
    *(1e3, 1e3 + 1e-10, math.nextafter(1e3, 2e3), 1e-9, 1e9, 1e18, 2.0**53 + 2.0, 1e22),
)
WORDS = (
    *("", " "),
    *["free", "drilling", "FREE", "none", "null", "true", "nan", "inf", "-", "~", "0", "1"],
    *("\x00", "a\x00b", "\n", "two\nlines", "\r", "\t", "\x1b[31m", "\u202e", "\ufeff", "\ufffd"),
    *("ä", "日本", "\U0001f4a5", "é" * 50),
    *["%s%n%d", "{0.__class__}", "$(reboot)", "../../etc/passwd"],
    *("/dev/zero", "/", ".", "a" * 10_000, "é" * 4_000, "'", '"', "\\", "<!--", "*", "&a", "!!int"),
)
WHOLES = (0, 1, 2, 3, 4, 5, 7, 8, 16, 64, 101, 127, 128, 200, 254, 255)


def number(random: random.Random) -> float:
    """A float of any kind: special, of any bit pattern, or near what is allowed."""
    choice = random.randrange(4)
    if choice == 0:
        return random.choice(NUMBERS)
    if choice == 1:
        return struct.unpack("<d", random.randbytes(8))[0]
    if choice == 2:
        return random.uniform(-2.0, 2.0) * 10.0 ** random.randrange(-12, 13)
    return -random.random()


def whole(random: random.Random, bits: int, signed: bool = False) -> int:
    """An integer that a field of so many bits can hold."""
    least = -(1 << (bits - 1)) if signed else 0
    most = (1 << (bits - signed)) - 1
    drawn = random.choice((least, most, most - 1, random.choice(WHOLES), random.getrandbits(bits)))
    return min(max(drawn, least), most)


def text(random: random.Random, surrogates: bool = True) -> str:
    """A text that is odd, long, empty or unprintable."""
    if random.random() < 0.7:
        return random.choice(WORDS)
    last = 0x10FFFF if surrogates else 0xD7FF
    points = (random.randrange(1, last + 1) for _ in range(random.randrange(1, 40)))
    return "".join(map(chr, points))


def name(random: random.Random, names: tuple[str, ...]) -> str:
    """One of the names, sometimes damaged, or any text."""
    choice = random.randrange(8)
    known = random.choice(names)
    if choice == 0:
        return text(random, surrogates=False)
    if choice == 1:
        return random.choice((known.upper(), known + " ", known[:-1], known * 2, f"/{known}"))
    return known


def fill(random: random.Random, message: Any, known: Mapping[str, Collection[Any]]) -> Any:
    """Give every field of a ROS message a value of its type, and return the message.

    Fields whose names are ``known`` get one of these values; texts among them are damaged at times.
    """
    for field, described in message.get_fields_and_field_types().items():
        kind = described.removeprefix("sequence<").removesuffix(">")
        count = 1 if kind == described else random.choice((0, 1, 1, 1, 2, 5))
        values = [_value(random, kind, tuple(known.get(field, ())), known) for _ in range(count)]
        setattr(message, field, values[0] if kind == described else values)
    return message


def _value(random: random.Random, kind: str, choices: tuple[Any, ...], known: Any) -> Any:
    if "/" in kind:
        return fill(random, message_class(kind.replace("/", "/msg/"))(), known)
    if kind == "string":
        return name(random, choices) if choices else text(random, surrogates=False)
    if choices:
        return random.choice(choices)
    if kind in ("boolean", "octet"):
        return random.random() < 0.5 if kind == "boolean" else random.randbytes(1)
    bits = re.search(r"\d+", kind)
    return whole(random, int(bits[0]), not kind.startswith("u")) if bits else number(random)
