"""Elements of a picture: paths, lines and texts as SVG. Places are in pixels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from rpud_sim.foundation.terminal import printable


def whole_parts(known: np.ndarray) -> Iterator[slice]:
    """Yield the parts of a series between its gaps."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    yield from (slice(*pair) for pair in edges.reshape(-1, 2))


def track(x: np.ndarray, y: np.ndarray, steps: bool = False) -> str:
    """Return the way through points; NaN is a gap."""
    texts = []
    for part in whole_parts(np.isfinite(x) & np.isfinite(y)):
        points = list(zip(x[part].tolist(), y[part].tolist(), strict=True))
        texts.append(f"M{points[0][0]:.1f} {points[0][1]:.1f}")
        texts += [f"H{a:.1f}V{b:.1f}" if steps else f"L{a:.1f} {b:.1f}" for a, b in points[1:]]
    return "".join(texts)


def segments(lines: Sequence[tuple[float, float, float, float]]) -> Markup:
    """Return straight lines in the colour around them."""
    return element("path", d="".join(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for a, b, c, d in lines))


def path(way: str, stroke: str, width: float = 0.0, **style: Any) -> Markup:
    """Return a path; it has no filling unless its style says so."""
    found: dict[str, Any] = {"fill": "none", "stroke": stroke, "stroke_width": width, **style}
    return element("path", d=way, **found)


def line(
    name: str, ends: tuple[float, float, float, float], text: str = "", **style: Any
) -> Markup:
    """Return a straight line with a text under the pointer."""
    places = dict(zip(("x1", "y1", "x2", "y2"), ends, strict=True))
    return element("line", (titled(text),), class_=name, **places, **style)


def text_at(text: str, x: float, y: float, anchor: str, name: str = "tick", **style: Any) -> Markup:
    inner = (escape(printable(text)),)
    return element("text", inner, class_=name, x=x, y=y, text_anchor=anchor, **style)


def titled(text: str) -> Markup:
    """Return the text under the pointer; nothing for an empty one."""
    return element("title", (escape(printable(text)),)) if text else Markup("")


def element(tag: str, inner: Sequence[Markup] = (), **attributes: Any) -> Markup:
    """Return an element; ``_`` in the name of an attribute stands for ``-``."""
    texts = [
        Markup(' {}="{}"').format(
            name.rstrip("_").replace("_", "-"), f"{v:.4g}" if isinstance(v, float) else v
        )
        for name, v in attributes.items()
    ]
    return Markup("<{0}{1}>{2}</{0}>").format(
        Markup(tag), Markup("").join(texts), Markup("").join(inner)
    )
