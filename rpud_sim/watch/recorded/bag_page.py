"""Page of a bag, as a document of Bokeh: plots over one range of time, cursor, playing, impacts."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import numpy as np
from bokeh.models import ColumnDataSource, RangeTool
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.embedding import controls, group_content, host, server_scripts
from rpud_sim.pages.figures import Drawn, draw_column, mark_sources
from rpud_sim.pages.frame import page_head_style
from rpud_sim.pages.paint import paint
from rpud_sim.pages.plot import GAP, Axis, Line, Mark, Plot, Stems, TimeColumn
from rpud_sim.watch.recorded.bag_view import Answerer, BagView
from rpud_sim.watch.recorded.contents import Content, Layer, contents, drills
from rpud_sim.watch.recorded.signals import IMPACTS, Signal
from rpud_sim.watch.recorded.window import MESSAGES, OVERVIEW, Answer, Request

if TYPE_CHECKING:
    from bokeh.document import Document

_SHARE = Path(__file__).parent / "share"
_GROUP = "time"
_SPEEDS = (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.25, 1.0, 4.0, 10.0, 100.0)
_PERIOD = 1000  # ms between looks at the state of the bag
_WIDTH = 1000  # pixels of a plot until the browser tells
_MOST_WIDTH = 4000  # pixels
_MARGIN = 0.02  # of the requested range, on either side
_NONE = np.empty(0)


def bag_application(view: BagView) -> Callable[[Document], None]:
    return lambda document: _Page(view, document).show()


class _Page:
    def __init__(self, view: BagView, document: Document) -> None:
        self._view = view
        self._document = document
        self._drills = drills(view.recording)
        self._drill = self._asked_drill()
        self._contents = [*contents(view.recording, self._drill, view.overview.has)]
        self._signals = view.recording.signals
        self._end = max(view.overview.end, 1e-6)
        self._answer: Answer | None = None
        self._pending = self._stale = False
        self._ask = ColumnDataSource({"json": ["{}"]}, name="rpud-ask")
        self._state = ColumnDataSource({"json": ["{}"]}, name="rpud-state")
        self._said, self._order = "", 0
        self._show: tuple[float, float] | None = None
        self._pin: float | None = None

    def show(self) -> None:
        """Fill the document; the bag is not read on meanwhile."""
        with self._view.asking():
            self._fill()

    def _fill(self) -> None:
        marks = self._marks()
        names = [f"plot-{number}" for number in range(len(self._contents))]
        column = TimeColumn(
            tuple(_plot(content, self._end) for content in self._contents), 0.0, self._end, marks
        )
        self._drawn = draw_column(column, names, live=True)
        self._range = self._drawn[0].figure.x_range if self._drawn else None
        self._timeline = self._draw_timeline(marks)
        document = self._document
        document.title = printable(self._view.recording.path.name or "bag")
        self._timeline.figure.tags = [*self._timeline.figure.tags, self._ask, self._state]
        document.template = _template()
        document.template_variables.update(self._variables(marks))
        self._ask.on_change("data", lambda attribute, old, new: self._hear())
        if self._range is not None:
            for end in ("start", "end"):
                self._range.on_change(end, lambda attribute, old, new: self._moved())
        self._show_answer(self._view.windows.answer(self._request()))
        with document.models.freeze():  # count all of them once, not after each
            for drawn in (self._timeline, *self._drawn):
                document.add_root(drawn.figure)
        self._answerer = Answerer(self._view, self._deliver)
        document.on_session_destroyed(lambda context: self._answerer.close())
        document.add_periodic_callback(self._look, _PERIOD)

    def _variables(self, marks: list[Mark]) -> dict[str, Any]:
        recording = self._view.recording
        plots = [
            {
                "number": number,
                "chosen": content.chosen,
                "selected": self._place(content.layers[0].signal) if content.chosen else -1,
                "name": drawn.figure.name,
                "host": partial(host, drawn.plot, drawn.figure.name, _GROUP),
            }
            for number, (content, drawn) in enumerate(zip(self._contents, self._drawn, strict=True))
        ]
        return {
            "style": page_head_style() + _share("bag.css"),
            "script": _share("bag.js"),
            "scripts": server_scripts(
                {
                    _GROUP: group_content(0.0, self._end, marks),
                    "timeline": group_content(0.0, self._end, marks),
                }
            ),
            "facts": printable(
                f"{recording.path}: {recording.duration:.6g} s, "
                f"{recording.message_count} messages, {recording.size / 1e6:.1f} MB"
            ),
            "drills": [
                (printable(name or "/"), f"?{urlencode({'drill': name})}", name == self._drill)
                for name in self._drills
            ],
            "controls": controls(_GROUP),
            "timeline": partial(host, self._timeline.plot, "timeline", "timeline"),
            "element": _element,
            "speeds": [(speed, f"{speed:g} times") for speed in _SPEEDS],
            "impacts": any(
                signal.type == IMPACTS and signal.drill == self._drill for signal in self._signals
            ),
            "plots": plots,
            "signals": [printable(signal.name) for signal in self._signals],
            "left_out": [
                (printable(name), printable(reason)) for name, reason in recording.left_out.items()
            ],
        }

    def _draw_timeline(self, marks: list[Mark]) -> Drawn:
        signals = [layer.signal for content in self._contents for layer in content.layers]
        self._main = next((signal for signal in signals if signal is not None), None)
        name = self._main.name if self._main else "nothing to draw"
        line = Line(printable(name), _NONE, _NONE, color=6, width=1.0)
        plot = Plot(
            "the whole bag",
            (line,),
            "Drag the shaded part, or its edges, to move what the plots show.",
            height=46,
        )
        column = TimeColumn((plot,), 0.0, self._end, marks, "timeline")
        drawn = draw_column(column, ["timeline"], live=True)[0]
        drawn.figure.toolbar.tools = []
        if self._range is not None:
            tool = RangeTool(x_range=self._range, start_gesture="pan")
            tool.overlay.fill_alpha = 0.25
            tool.overlay.line_width = 1.5
            tool.overlay.line_dash = "solid"
            paint(tool.overlay, fill_color="accent", line_color="accent")
            drawn.figure.add_tools(tool)
        self._fill_timeline(drawn)
        return drawn

    def _fill_timeline(self, drawn: Drawn) -> None:
        if self._main is not None:
            trace = self._view.overview.view(self._main, 0.0, self._end, _WIDTH)
            for source in drawn.sources.values():
                source.data = {"x": trace.x, "y": trace.y}

    def _asked_drill(self) -> str:
        context = self._document.session_context
        arguments = context.request.arguments if context and context.request else {}
        wanted = arguments.get("drill", [b""])[0].decode(errors="replace")
        return wanted if wanted in self._drills or not self._drills else self._drills[0]

    def _place(self, signal: Signal | None) -> int:
        return self._signals.index(signal) if signal in self._signals else -1

    def _request(self) -> Request:
        start, end = 0.0, self._end
        if self._range is not None:
            start, end = float(self._range.start), float(self._range.end)
        if not (math.isfinite(start) and math.isfinite(end) and start < end):
            start, end = 0.0, self._end
        margin = _MARGIN * (end - start)
        return Request(
            self._drill,
            max(start - margin, 0.0),
            min(end + margin, self._end),
            self._width(),
            {
                (number, place): layer
                for number, content in enumerate(self._contents)
                for place, layer in enumerate(content.layers)
            },
        )

    def _width(self) -> int:
        """Return the width of the plots [pixels], as far as the browser has told."""
        figure = self._drawn[0].figure if self._drawn else None
        told = figure.properties_with_values(include_defaults=False) if figure else {}
        return min(max(int(told.get("inner_width") or _WIDTH), 100), _MOST_WIDTH)

    def _moved(self) -> None:
        if not self._pending:
            self._pending = True
            self._document.add_next_tick_callback(self._ask_now)

    def _ask_now(self) -> None:
        self._pending = False
        self._answerer.ask(self._request())

    def _deliver(self, answer: Answer) -> None:
        """Hand an answer over to the loop of the server; called in the answering thread."""
        self._document.add_next_tick_callback(partial(self._show_answer, answer))

    def _show_answer(self, answer: Answer) -> None:
        self._answer = answer
        for (number, place), trace in answer.traces.items():
            layer = self._contents[number].layers[place]
            if layer == answer.request.layers[number, place]:
                source = self._drawn[number].sources[layer.name]
                source.data = {"x": trace.x, "y": trace.y}
        self._draw_marks()
        self._publish()

    def _look(self) -> None:
        complete = self._view.overview.progress.complete
        if not self._stale or not complete:
            self._fill_timeline(self._timeline)
            if self._answer is not None and self._answer.detail == OVERVIEW:
                self._answerer.ask(self._request())
            self._draw_marks()
        self._stale = complete  # once more after the end: the gaps are known then
        self._publish()

    def _draw_marks(self) -> None:
        """Draw the marks; where the overview is shown, what is not read yet looks like a gap."""
        overview = self._answer is None or self._answer.detail == OVERVIEW
        shown = ((self._timeline, True), *((drawn, overview) for drawn in self._drawn[:1]))
        for drawn, unread in shown:
            for kind, source in mark_sources(self._marks(unread=unread), self._end).items():
                old = drawn.marks[kind]
                if any(not np.array_equal(old.data[name], source.data[name]) for name in old.data):
                    old.data = dict(source.data)

    def _marks(self, *, unread: bool = False) -> list[Mark]:
        found = self._view.marks.of(self._drill)
        progress = self._view.overview.progress
        if unread and not progress.complete:
            text = "not read yet: only a sample of it is shown"
            found.append(Mark(GAP, min(progress.until, self._end), text, self._end))
        return found

    def _publish(self) -> None:
        progress = self._view.overview.progress
        answer = self._answer
        text = json.dumps(
            {
                "banner": printable(self._view.banner),
                "read": "The whole bag was read."
                if progress.complete
                else f"Read {100.0 * progress.share:.1f} % of the bag.",
                "detail": _detail(answer),
                "kind": answer.detail if answer else "",
                "range": [answer.request.start, answer.request.end] if answer else [],
                "said": self._said,
                "order": self._order,
                "show": self._show,
                "pin": self._pin,
                "marks": group_content(0.0, self._end, self._marks())["marks"],
            }
        )
        if self._state.data["json"][0] != text:
            self._state.data = {"json": [text]}

    def _hear(self) -> None:
        """Do what the page asks for; whatever is not understood is ignored."""
        try:
            asked = json.loads(self._ask.data["json"][0])
            act = asked["act"]
            if act == "choose":
                self._choose(int(asked["plot"]), int(asked["signal"]))
            elif act in ("next", "back", "contact"):
                self._answerer.ask(partial(self._find_impact, act, float(asked["time"])))
        except (IndexError, KeyError, TypeError, ValueError):
            return

    def _choose(self, number: int, place: int) -> None:
        content = self._contents[number]
        if content.chosen and 0 <= place < len(self._signals):
            layer = Layer(content.layers[0].name, self._signals[place])
            self._contents[number] = Content(content.title, "", (layer,), chosen=True)
            self._answerer.ask(self._request())

    def _find_impact(self, act: str, time: float) -> None:
        """Find an impact; called in the answering thread."""
        windows = self._view.windows
        if act == "contact":
            impact = windows.impact(self._drill, math.nextafter(time, math.inf) + 1e-9, back=True)
            impact = impact or windows.impact(self._drill, time)
        else:
            step = -1e-9 if act == "back" else 1e-9
            impact = windows.impact(self._drill, time + step, back=act == "back")
        show = None
        if impact is None:
            said = f"There is no impact {'before' if act == 'back' else 'after'} {time:.9g} s."
        else:
            duration = impact.duration if impact.duration > 0.0 else 1e-5
            said = (
                f"Impact at {impact.time:.9f} s: peak force {impact.peak_force:.6g} N, "
                f"contact {1e6 * duration:.4g} µs."
            )
            if act == "contact":
                show = impact.time - 0.5 * duration, impact.time + 1.5 * duration
        pin = impact.time if impact else None
        self._document.add_next_tick_callback(partial(self._tell, said, pin, show))

    def _tell(self, said: str, pin: float | None, show: tuple[float, float] | None) -> None:
        self._said, self._pin, self._show = said, pin, show
        self._order += 1
        self._publish()


def _plot(content: Content, end: float) -> Plot:
    names = ", ".join(layer.name for layer in content.layers)
    alt = f"{content.title} over {end:.6g} s: {names}. The legend has the values at the cursor."
    colors = [number - sum(each.spread for each in content.layers[: number + 1])
              for number in range(len(content.layers))]  # fmt: skip
    layers = tuple(
        Stems(layer.name, _NONE, _NONE, color=1)
        if layer.points
        else Line(layer.name, _NONE, _NONE, color=1 if layer.spread else color + 1)
        for layer, color in zip(content.layers, colors, strict=True)
    )
    return Plot(printable(content.title), layers, printable(alt), Axis(unit=content.unit))


def _detail(answer: Answer | None) -> str:
    if answer is None:
        return ""
    if answer.detail == OVERVIEW:
        return "Shown: least and greatest values of parts of the time."
    if answer.detail == MESSAGES:
        return "Shown: every message."
    rate = f"{answer.rate / 1e6:.6g} MHz"
    return f"Shown: every impact, and the exact waveform at {rate} in place of its samples."


def _element(root: Any) -> Markup:
    html = Markup('<div id="{}" data-root-id="{}" style="display: contents"></div>')
    return html.format(root.elementid, root.id)


def _share(name: str) -> str:
    return (_SHARE / name).read_text(encoding="utf-8")


def _template() -> Any:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.from_string(_share("bag.html"))
