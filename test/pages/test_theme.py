"""Colours stand out from their backgrounds in both themes, and both themes have the same names."""

import pytest

from rpud_sim.pages.theme import DARK, LIGHT, SERIES, css_variables, series_color


def luminance(color):
    parts = [int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
    linear = [p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_contrast_is_what_readers_need(theme):
    for name in ("text", "muted", "accent", "warning"):
        for background in ("paper", "panel"):
            assert contrast(theme[name], theme[background]) >= 4.5, (name, background)
    for name in ("command", "fault", *(series_color(number) for number in range(SERIES))):
        assert contrast(theme[name], theme["paper"]) >= 3.0, name


def test_both_themes_name_the_same_colours():
    assert LIGHT.keys() == DARK.keys()
    assert series_color(SERIES) == series_color(0)
    style = css_variables()
    assert style.count("--series0:") == 2
    assert style.index("prefers-color-scheme:dark") > style.index(LIGHT["series0"])
