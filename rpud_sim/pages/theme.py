"""Colours of all pages, for readers who prefer light or dark; plots use them by name."""

from __future__ import annotations

from collections.abc import Mapping

# Text has a contrast of at least 4.5 to its background, lines one of at least 3. Neighbouring
# series differ with every kind of colour vision (after Okabe and Ito).
LIGHT: Mapping[str, str] = {
    "paper": "#ffffff",
    "panel": "#eef3f7",
    "text": "#1c2733",
    "muted": "#526170",
    "rule": "#dde3e9",
    "accent": "#0067a3",
    "warning": "#b34700",
    "command": "#6d3fc0",
    "fault": "#c9302c",
    "series0": "#0072b2",
    "series1": "#c75300",
    "series2": "#007d5c",
    "series3": "#a8437f",
    "series4": "#8f6500",
    "series5": "#3b7fd4",
    "series6": "#5b6b7a",
}
DARK: Mapping[str, str] = {
    "paper": "#12181f",
    "panel": "#1d2731",
    "text": "#e6edf3",
    "muted": "#a3b1bf",
    "rule": "#33404d",
    "accent": "#6cb8f0",
    "warning": "#ff9d5c",
    "command": "#b69cff",
    "fault": "#ff7b72",
    "series0": "#56b4e9",
    "series1": "#ff9a52",
    "series2": "#2fc79a",
    "series3": "#e89ac7",
    "series4": "#e8bd45",
    "series5": "#9fc5ff",
    "series6": "#b6c2cf",
}

# Number of colours for series; further series begin again with the first.
SERIES = sum(name.startswith("series") for name in LIGHT)


def series_color(number: int) -> str:
    """Return the name of the colour of a series, counted from zero."""
    return f"series{number % SERIES}"


def css_variables() -> str:
    """Return style that sets each colour as a variable, such as ``--accent``."""
    light = "".join(f"--{name}:{value};" for name, value in LIGHT.items())
    dark = "".join(f"--{name}:{value};" for name, value in DARK.items())
    return (
        f":root{{color-scheme:light dark;{light}}}\n"
        f"@media (prefers-color-scheme:dark){{:root{{{dark}}}}}\n"
    )
