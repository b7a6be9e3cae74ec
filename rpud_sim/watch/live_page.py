"""Page of a running drill, as a document of Bokeh: section, plots, state, and controls.

The server sends frames, JSON texts with what has changed, and the browser acknowledges each. It
sends none while one is under way: a page that cannot keep up gets fewer frames, and delays no
other. What is heard of the drill is kept by ``LiveDrill``, so that no message is lost.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.models import ColumnDataSource
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.embedding import controls, host, server_scripts
from rpud_sim.pages.figures import Drawn, draw_column
from rpud_sim.pages.frame import page_head_style
from rpud_sim.pages.plot import Axis, Envelope, Line, Plot, TimeColumn
from rpud_sim.ros.client.plain_message import to_json_value
from rpud_sim.watch.frames import Frames

if TYPE_CHECKING:
    from bokeh.document import Document

    from rpud_sim.watch.live_drill import LiveDrill

PERIOD = 200  # time between frames [ms]

_SHARE = Path(__file__).parent / "share"
_GROUP = "live"
_NONE = np.empty(0)
_WIDTH = 20.0  # of the range of time at first [s]
_LONGEST_REQUEST = 2_000  # characters
_BANDS = (
    "Bands reach from the least to the greatest value of each 0.05 s; the line is their middle."
)


def _envelope(name: str, color: int) -> Envelope:
    return Envelope(name, _NONE, _NONE, _NONE, _NONE, color)


def _steps(name: str, color: int, dash: Any = "solid") -> Line:
    return Line(name, _NONE, _NONE, steps=True, color=color, dash=dash)


# Plots of the page; ``live.js`` fills their sources, which it finds by the names of the layers.
PLOTS = (
    Plot(
        "peak force of the impacts",
        (_envelope("peak force", 1),),
        _BANDS,
        Axis(unit="kN", low=0.0),
    ),
    Plot(
        "motion, positive toward the rock",
        (_envelope("nodal plane", 0), _envelope("free mass", 1), _envelope("drill tool", 2)),
        _BANDS,
        Axis(unit="mm"),
    ),
    Plot(
        "load on the mount",
        (_envelope("reacting force", 0), _steps("weight on bit", 3, "dashed")),
        _BANDS,
        Axis(unit="N"),
    ),
    Plot(
        "power, mean of a second",
        (
            _steps("of the vibration", 0),
            _steps("into tool and rock", 1),
            _steps("lost in the load damper", 2),
            _steps("lost in collisions", 4),
            _steps("electrical", 3),
        ),
        "",
        Axis(unit="W"),
        height=140,
    ),
    Plot(
        "latest block of each second",
        (_steps("late by", 1),),
        "How late the drill has published the latest of its blocks.",
        Axis(unit="ms", low=0.0),
        height=80,
    ),
    Plot(
        "force of the arm on the mount",
        (_envelope("arm", 0),),
        _BANDS,
        Axis(unit="N"),
        height=140,
    ),
    Plot(
        "feed, mount and depth of the hole",
        (_envelope("feed", 0), _envelope("mount", 1), _envelope("depth", 2)),
        _BANDS,
        Axis(unit="mm"),
    ),
    Plot("rotation", (_envelope("rate of rotation", 0),), _BANDS, Axis(unit="rad/s"), height=140),
    Plot(
        "torque",
        (_envelope("of rock and cuttings", 1), _envelope("of the drive", 0)),
        _BANDS,
        Axis(unit="N m"),
        height=140,
    ),
)

# Topics without which plots are hidden: a drill whose model is off does not publish them.
_NEEDED = {
    "force of the arm on the mount": "mount",
    "feed, mount and depth of the hole": "mount",
    "rotation": "rotation",
    "torque": "rotation",
}


def live_application(
    drill_of: Callable[[str], LiveDrill],
    release: Callable[[LiveDrill], object],
    default: Callable[[], str],
) -> Callable[[Document], None]:
    """Return the function that fills a document with the page of a drill.

    ``drill_of`` raises an error of one line if there can be no drill. ``release`` is called when
    the browser tab is gone. ``default`` is the namespace of a page that names none.
    """

    def fill(document: Document) -> None:
        arguments = document.session_context.request.arguments
        given = arguments.get("namespace", [b""])[0].decode(errors="replace")
        try:
            drill = drill_of(given or default())
        except Exception as error:
            document.template = _template("refused.html")
            document.title = "no drill"
            document.template_variables.update(
                style=page_head_style(), reason=printable(" ".join(str(error).split()))
            )
            return
        _Page(drill, document).show()
        document.on_session_destroyed(lambda context: release(drill))

    return fill


class _Page:
    def __init__(self, drill: LiveDrill, document: Document) -> None:
        self._drill = drill
        self._document = document
        self._frames = Frames(drill.namespace)
        self._frame = ColumnDataSource({"json": ["{}"]}, name="rpud-frame")
        self._heard = ColumnDataSource({"json": ["{}"]}, name="rpud-heard")
        self._request = ColumnDataSource({"json": ["{}"]}, name="rpud-request")
        self._awaited: int | None = 0  # number of the frame under way; 0 for the page itself

    def show(self) -> None:
        document = self._document
        column = TimeColumn(PLOTS, 0.0, _WIDTH, (), _GROUP)
        drawn = draw_column(column, [f"live-{number}" for number in range(len(PLOTS))], live=True)
        # Models that are not drawn come to the browser with one that is.
        first = drawn[0].figure
        first.tags = [*first.tags, self._frame, self._heard, self._request]
        for each in drawn:
            document.add_root(each.figure)
        document.title = f"drill {printable(self._drill.namespace)}"
        document.template = _template("live.html")
        document.template_variables.update(self._variables(drawn))
        self._heard.on_change("data", lambda name, old, new: self._acknowledged(new))
        self._request.on_change("data", lambda name, old, new: self._act(new))
        document.add_periodic_callback(self._send, PERIOD)

    def _variables(self, drawn: tuple[Drawn, ...]) -> dict[str, Any]:
        return {
            "style": page_head_style() + _share("live.css"),
            "script": _share("section.js") + _share("live.js"),
            "scripts": server_scripts({_GROUP: {}}),
            "controls": controls(_GROUP),
            "plots": [
                (lambda root, each=each: host(each.plot, each.figure.name, _GROUP, _element(root)))
                for each in drawn
            ],
            "names": [each.figure.name for each in drawn],
            "needed": [_NEEDED.get(each.plot.title, "") for each in drawn],
            "namespace": printable(self._drill.namespace),
        }

    def _send(self) -> None:
        picture = self._drill.picture()
        if self._awaited is not None:
            self._frames.drop(picture)
            return
        frame = self._frames.next(picture)
        if frame is not None:
            self._awaited = frame["number"]
            text = json.dumps(to_json_value(frame), separators=(",", ":"), allow_nan=False)
            self._frame.data = {"json": [text]}

    def _acknowledged(self, data: Any) -> None:
        content = _content(data)
        if content.get("number") == self._awaited:
            self._awaited = None
        if content.get("section") is True:
            self._frames.want_section()

    def _act(self, data: Any) -> None:
        content = _content(data)
        name, arguments = content.get("name"), content.get("arguments")
        if not isinstance(name, str) or not isinstance(arguments, dict):
            return
        try:
            self._drill.act(name, **arguments)
        except ParameterError as error:
            self._frames.refuse(str(error))
        except TypeError:  # an argument called `name`
            self._frames.refuse("these are no arguments of an action")


def _content(data: Any) -> dict[str, Any]:
    """Return the JSON object that the browser has put into a source; empty for anything else."""
    try:
        [text] = data["json"]
        content = json.loads(text[:_LONGEST_REQUEST])
    except (KeyError, TypeError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _element(root: Any) -> Markup:
    html = Markup('<div id="{}" data-root-id="{}" style="display: contents"></div>')
    return html.format(root.elementid, root.id)


def _template(name: str) -> Any:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.from_string(_share(name))


def _share(name: str) -> str:
    return (_SHARE / name).read_text(encoding="utf-8")
