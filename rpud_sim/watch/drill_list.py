"""List of all drills of a domain, a plain page that looks for new ones by itself."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from urllib.parse import urlencode

from bokeh.server.views.auth_request_handler import AuthRequestHandler
from jinja2 import Environment, StrictUndefined

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.frame import page_head_style
from rpud_sim.ros.client.drill_finder import DrillFinder

_SHARE = Path(__file__).parent / "share"


def drill_path(namespace: str) -> str:
    return f"/drill?{urlencode({'namespace': namespace}, safe='/')}"


class ListPage(AuthRequestHandler):
    """Page with the list."""

    def initialize(self, finder: DrillFinder) -> None:
        self._finder = finder

    def get(self) -> None:
        """Answer with the page; its script asks for the drills."""
        environment = Environment(autoescape=True, undefined=StrictUndefined)
        page = environment.from_string((_SHARE / "list.html").read_text(encoding="utf-8"))
        self.finish(page.render(style=page_head_style(), domain=self._finder.domain_id))


class ListData(AuthRequestHandler):
    """Drills as JSON."""

    def initialize(self, finder: DrillFinder) -> None:
        self._finder = finder

    def get(self) -> None:
        found = [
            {
                **{
                    name: printable(value) if isinstance(value, str) else value
                    for name, value in dataclasses.asdict(drill).items()
                },
                "path": drill_path(drill.namespace),
            }
            for drill in self._finder.drills()
        ]
        self.set_header("Content-Type", "application/json")
        self.set_header("Cache-Control", "no-store")
        self.finish(json.dumps({"domain": self._finder.domain_id, "drills": found}))
