"""The screen as one file: its modules joined to one script, and its data in base64."""

from __future__ import annotations

import base64
import hashlib
import html
import re
from importlib.resources import files

from rpud_sim.foundation.terminal import printable

_IMPORT = re.compile(r'^import .*? from "\./([\w.]+)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=class|function|const|let)", re.MULTILINE)
_STYLE = re.compile(r'<link rel="stylesheet" href="[^"]*?([\w./]+\.css)">\n?')
_SCRIPT = re.compile(r'<script[^>]*src="[^"]*?([\w./]+\.js)"[^>]*></script>\n?')
_SHARE = "share/"


def frozen_page(title: str, frame: bytes) -> str:
    """Return the screen with one frame, as one HTML file that needs no server and no network.

    Its policy allows no request, and no script or style but these, by their hashes.
    """
    text = _asset("screen.html")
    styles = "\n".join(_asset(name.removeprefix(_SHARE)) for name in _STYLE.findall(text))
    vendored, entry = (name.removeprefix(_SHARE) for name in _SCRIPT.findall(text))
    library, program = _asset(vendored), _joined(entry)
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(styles)}; "
        f"script-src {_hash(library)} {_hash(program)}; base-uri 'none'; form-action 'none'"
    )
    head = (
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n<style>{styles}</style>\n'
    )
    tail = (
        '<script type="application/octet-stream;base64" class="frame">'
        f"{base64.b64encode(frame).decode()}</script>\n"
        f'<script>{library}</script>\n<script type="module">{program}</script>\n</body>'
    )
    text = _SCRIPT.sub("", _STYLE.sub("", text))
    text = re.sub(
        "<title>.*?</title>",
        lambda _: f"<title>{html.escape(printable(title))}</title>\n{head}",
        text,
        count=1,
    )
    return text.replace("</body>", tail)


def _joined(entry: str) -> str:
    """Return a module and all that it imports as one, each after what it needs."""
    order: list[str] = []
    waiting: set[str] = set()

    def visit(name: str) -> None:
        if name in waiting:
            return
        waiting.add(name)
        for needed in _IMPORT.findall(_asset(name)):
            visit(needed)
        order.append(name)

    visit(entry)
    return "\n".join(_EXPORT.sub("", _IMPORT.sub("", _asset(name))) for name in order)


def _asset(name: str) -> str:
    return files("rpud_sim.viewer").joinpath("share", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
