"""Hostile values: what no careful client sends. All are drawn from a seeded `random.Random`."""

from __future__ import annotations

import math
import random
import struct
import sys
from typing import Any

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


def value(random: random.Random, depth: int = 2) -> Any:
    """A Python value of any type that YAML or a caller may give."""
    choice = random.randrange(10 if depth else 7)
    if choice < 2:
        return number(random)
    if choice == 2:
        return random.choice((-1, 0, 1, 10**400, -(10**400), 2**64, -(2**63)))
    if choice == 3:
        return random.choice((None, True, False, b"\xff\x00", 1j, object))
    if choice < 7:
        return text(random)
    items = [value(random, depth - 1) for _ in range(random.randrange(4))]
    if choice == 7:
        return items
    if choice == 8:
        return tuple(items)
    return {text(random): item for item in items}


def yaml(random: random.Random, templates: tuple[str, ...], names: tuple[str, ...]) -> bytes:
    """The bytes of a YAML file: a good one that was damaged, one built to hurt, or noise."""
    choice = random.randrange(10)
    if choice == 0:
        return random.randbytes(random.randrange(200))
    if choice == 1:
        return _nasty(random).encode("utf-8", "surrogatepass")
    content = random.choice(templates)
    for _ in range(random.randrange(4)):
        content = _damaged(random, content, names)
    return content.encode("utf-8", "surrogatepass")


def scalar(random: random.Random) -> str:
    """One scalar, or something else in its place, as YAML that a user may write."""
    return random.choice(
        (
            *("~", "null", "yes", "off", ".nan", "-.inf", ".inf", "1e400", "-0", "0x1F", "0o17"),
            *("1_000", "190:20:30", "2001-01-01", "2001-99-99", "!!binary aGk=", "!!binary ~"),
            *("!!python/object/apply:os.system [true]", "!!float x", "!!int ''", "!!set {a}"),
            *("!!timestamp 1", "!<x> 1", "*alias", "&a [*a]", "<<", "[", "{", "]", "}"),
            *("- -", "? :"),
            *("|", ">", "'", '"\\x"', "%", "@", "`", "[[[]]]", "{a: {b: c}}", "uniform: [1, 0]"),
            *("{uniform: [0, .nan]}", "{uniform: [1]}", "1" * 5_000, "[" * 300, "a" * 2_000),
            repr(number(random)),
            str(whole(random, 64, signed=True)),
            text(random),
        )
    )


def _damaged(random: random.Random, content: str, names: tuple[str, ...]) -> str:
    choice = random.randrange(6)
    place = random.randrange(len(content) + 1)
    if choice == 0:
        return content[:place] + text(random) + content[place:]
    if choice == 1:
        return content[:place] + content[place + random.randrange(1, 9) :]
    if choice == 2:
        return content[:place]
    lines = content.splitlines() or [""]
    index = random.randrange(len(lines))
    if choice == 3:
        lines.insert(index, random.choice(lines))
    elif choice == 4:
        indent = lines[-1][: len(lines[-1]) - len(lines[-1].lstrip())]
        lines.append(f"{indent}{name(random, names)}: 1")
    else:
        key, colon, _ = lines[index].partition(": ")
        lines[index] = f"{key}{colon}{scalar(random)}"
    return "\n".join(lines)


def _nasty(random: random.Random) -> str:
    deep = random.choice((10, 100, 100, 1_000, 1_000, 20_000))
    return random.choice(
        (
            "[" * deep,
            "{a: " * deep,
            "- " * deep,
            "".join(" " * level + "a:\n" for level in range(min(deep, 300))),
            "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]",
            "&a [*a]",
            "a: 1\n" * deep,
            "x" * 100_001,
            "a: " + "9" * 5 * deep,
            "---\na: 1\n---\nb: 2",
            "? [a, {b: c}]\n: d",
            "{[]: 1}",
            "{{}: {}}",
            "%YAML 9.9\n---\na",
            "\t",
            "\ufeff{}",
            "seed: !!python/name:os.system",
            "<<: {a: 1}",
            "<<: [1]",
            "=: 1",
        )
    )
