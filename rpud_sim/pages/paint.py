"""Colours of Bokeh models by name, so that the page can change them with the reader's theme."""

from __future__ import annotations

import json

from bokeh.models import Model

from rpud_sim.pages.theme import LIGHT


def paint(model: Model, **colors: str) -> None:
    """Set colours of a model, by property, by their names in ``theme``: first the light theme's."""
    model.update(**{name: LIGHT[color] for name, color in colors.items()})
    model.tags = [*model.tags, json.dumps({"paint": colors})]
