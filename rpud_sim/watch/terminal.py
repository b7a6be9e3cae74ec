"""View of a running drill in a terminal: for a serial console, or over ssh."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal
from textual.suggester import SuggestFromList
from textual.widgets import Input, Static

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.client.drill_finder import DrillFinder, FoundDrill
from rpud_sim.watch.live_drill import LiveDrill
from rpud_sim.watch.picture import Picture
from rpud_sim.watch.terminal_course import ASCII, BLOCKS
from rpud_sim.watch.terminal_page import Face, list_of, page_of
from rpud_sim.watch.terminal_prompts import PROMPTS, Prompt, has_feed
from rpud_sim.watch.terminal_screen import Lines

UPDATES = 2.0
"""Updates of the terminal in a second: some 1000 characters, as many as 9600 baud carry."""

_KEYS = "d drive  e engage  i inject  c clear  space pause  s step  r reset  q quit"
_SEARCH_PERIOD = 1.0  # between looks at which drills there are [s]
_PLAIN_TERMINALS = ("ansi", "vt100", "vt102", "vt220", "vt320")  # which know no block characters


class TerminalView(App[None]):
    """Shows one drill, and acts on it by keys; a list where there are several.

    Colours are those of the terminal, so that it is readable on a light and on a dark one.

    Args:
        open_drill: opens the drill of a namespace.
        namespace: of the drill to show first; None for the only one, or a list.
        updates: of the terminal in a second at most.
    """

    TITLE = "rpud watch"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    Screen { background: ansi_default; color: ansi_default; }
    #hint { height: auto; min-height: 1; max-height: 4; }
    #keys { height: 1; text-style: reverse; }
    #prompt { height: 1; display: none; }
    #label { width: auto; text-style: bold; }
    Input, Input:focus { height: 1; border: none; padding: 0; width: 1fr; }
    """
    BINDINGS: ClassVar = [
        *(Binding(prompt.key, f"ask('{name}')") for name, prompt in PROMPTS.items()),
        Binding("e", "engage"),
        Binding("space", "pause"),
        Binding("l", "list"),
        Binding("escape", "cancel", priority=True),
        Binding("q", "quit"),
        Binding("ctrl+c", "quit", priority=True),
    ]

    def __init__(
        self,
        open_drill: Callable[[str], LiveDrill],
        finder: DrillFinder,
        namespace: str | None = None,
        updates: float = UPDATES,
        environment: Mapping[str, str] = os.environ,
    ) -> None:
        super().__init__(ansi_color=True)
        self.theme = "ansi-dark"  # whose foreground and background are the terminal's own
        self.animation_level = "none"
        self._open = open_drill
        self._finder = finder
        self._updates = updates
        self._steps = ASCII if speaks_ascii(environment) else BLOCKS
        self._found: Sequence[FoundDrill] = ()
        self._drill = None if namespace is None else open_drill(namespace)
        self._searching = namespace is None
        self._asked: Prompt | None = None
        self._lines = Lines()
        # Kept, as the page is: the last drawing may come when the screen has none of them any more.
        self._keys = Static("", id="keys", markup=False)

    @property
    def shown(self) -> str:
        """Text of the page."""
        return self._lines.text

    @property
    def drill(self) -> LiveDrill | None:
        """The drill that is shown."""
        return self._drill

    @property
    def picture(self) -> Picture | None:
        """Latest picture of the drill."""
        return self._drill.picture() if self._drill else None

    def compose(self) -> ComposeResult:
        """Make the widgets: the page, a line for questions, and the keys."""
        yield self._lines
        yield Static("", id="hint", markup=False)
        with Horizontal(id="prompt"):
            yield Static("", id="label", markup=False)
            yield Input(compact=True, id="answer")
        yield self._keys

    def on_mount(self) -> None:
        """Begin to look and to draw."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, self.exit)  # which restores the terminal
        self.query_one(Input).can_focus = False
        self.set_focus(None)
        self._look()
        self.set_interval(_SEARCH_PERIOD, self._look)
        self.set_interval(1.0 / self._updates, self._draw)

    def close(self) -> None:
        """Leave the graph; the drill goes on."""
        if self._drill is not None:
            self._drill.close()

    def on_resize(self) -> None:
        """Fit the page to the terminal."""
        self._draw()

    # Keys

    def action_ask(self, name: str) -> None:
        """Ask for the arguments of an action."""
        if (picture := self.picture) is not None:
            self._ask(PROMPTS[name], picture)

    def action_engage(self) -> None:
        """Put the tool into the rock, or take it out."""
        if (picture := self.picture) is not None and picture.status:
            self._act("engage", {"on": picture.status["regime"] != "drilling"})

    def action_pause(self) -> None:
        """Let time stand still, or pass."""
        if (picture := self.picture) is not None and picture.status:
            self._act("pause" if picture.status["state"] == "running" else "play", {})

    def action_list(self) -> None:
        """Show the list of drills."""
        self._show_drill(None)

    def action_cancel(self) -> None:
        """Ask no more."""
        self._close_prompt()

    def on_key(self, event: Any) -> None:
        """Choose a drill of the list by its number."""
        if self._drill is None and event.character and event.character.isdecimal():
            number = int(event.character)
            if 1 <= number <= len(self._found):
                self._show_drill(self._found[number - 1].namespace)

    def on_input_submitted(self, submitted: Input.Submitted) -> None:
        """Do what was asked for."""
        prompt, text = self._asked, submitted.value
        self._close_prompt()
        picture = self.picture
        if prompt is None or picture is None:
            return
        try:
            arguments = prompt.read(text, picture)
        except ParameterError as error:
            self._hint(str(error))
            return
        if arguments is not None:
            self._act(prompt.action, arguments)

    # Inside

    def _act(self, name: str, arguments: Mapping[str, Any]) -> None:
        assert self._drill is not None  # an action needs a picture
        try:
            self._drill.act(name, **arguments)
        except ParameterError as error:
            self._hint(str(error))
        else:
            self._hint("")
        self._draw()

    def _ask(self, prompt: Prompt, picture: Picture) -> None:
        self._asked = prompt
        field = self.query_one(Input)
        field.suggester = SuggestFromList(prompt.suggestions(picture))
        field.value = prompt.default(picture)
        field.cursor_position = len(field.value)
        self.query_one("#label", Static).update(f" {prompt.question} ")
        self._hint(prompt.hint(picture))
        self._keys.display = False
        self.query_one("#prompt").display = True
        field.can_focus = True
        field.focus()

    def _close_prompt(self) -> None:
        self._asked = None
        field = self.query_one(Input)
        field.can_focus = False
        self.set_focus(None)
        self.query_one("#prompt").display = False
        self._keys.display = True
        self._hint("")

    def _hint(self, text: str) -> None:
        self.query_one("#hint", Static).update(printable(f" {text}" if text else ""))

    def _look(self) -> None:
        """Look which drills there are; the only one is shown by itself."""
        before, self._found = self._found, self._finder.drills()
        # At the second look: drills are not discovered all at once.
        if self._searching and self._drill is None and len(before) == len(self._found) == 1:
            self._show_drill(self._found[0].namespace)

    def _show_drill(self, namespace: str | None) -> None:
        self._searching = False
        before, self._drill = self._drill, None
        if before is not None:
            self.run_worker(before.close, thread=True)  # it may wait for a moment
        if namespace is not None:
            self._drill = self._open(namespace)
        self._draw()

    def _draw(self) -> None:
        face = Face(self.size.width, max(1, self._lines.size.height), self._steps)
        picture = self.picture
        if picture is None:
            self._lines.show(list_of(self._found, face))
            keys = " 1-9 shows a drill   q quit"
        else:
            self._lines.show(page_of(picture, face, len(self._found)))
            keys = keys_of(picture)
        if len(keys) > face.width:
            keys = keys.replace("  ", " ")
        keys = f"{keys:{face.width}}"
        if keys != self._keys.content:
            self._keys.update(keys)


def keys_of(picture: Picture) -> str:
    """Return the line of keys: a drill on an arm takes a feed, any other a weight on bit."""
    return f" {'f feed' if has_feed(picture) else 'p press'}  {_KEYS}"


def speaks_ascii(environment: Mapping[str, str]) -> bool:
    """Return whether a terminal knows no more than ASCII, by its environment."""
    if environment.get("TERM", "") in _PLAIN_TERMINALS:
        return True
    locale = next(filter(None, map(environment.get, ("LC_ALL", "LC_CTYPE", "LANG"))), "")
    return bool(locale) and "UTF" not in locale.upper() and locale not in ("C", "POSIX")
