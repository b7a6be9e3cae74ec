"""Answers to the questions of the terminal, and the keys that it names."""

import math

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.watch.picture import CONNECTED, Connection, Picture
from rpud_sim.watch.terminal import keys_of
from rpud_sim.watch.terminal_page import WIDTH
from rpud_sim.watch.terminal_prompts import PROMPTS, read_feed


def picture(**status):
    return Picture("/rpud", Connection(CONNECTED, 0.0), status=status)


ON_AN_ARM = picture(feed_mode=0, feed_value=0.0)
WITHOUT_ARM = picture(feed_mode=0, feed_value=math.nan)


@pytest.mark.parametrize(
    ("text", "arguments"),
    [
        ("0.0005", {"rate": 0.0005}),
        (" -1e-3 ", {"rate": -0.001}),
        ("0", {"rate": 0.0}),
        ("to 0.01", {"position": 0.01}),
        ("", None),
        ("  ", None),
    ],
)
def test_a_feed_is_a_rate_or_to_and_a_position(text, arguments):
    assert read_feed(text, ON_AN_ARM) == arguments


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("fast", "rate = 'fast' is not a number"),
        ("to there", "position = 'there' is not a number"),
        ("to", "feed = 'to' is not a rate, or to and a position"),
        ("1e-3 0.01", "feed = '1e-3 0.01' is not a rate, or to and a position"),
        ("to 0.01 0.02", "feed = 'to 0.01 0.02' is not a rate, or to and a position"),
    ],
)
def test_what_is_no_feed_is_refused_with_the_reason(text, reason):
    with pytest.raises(ParameterError) as refused:
        read_feed(text, ON_AN_ARM)
    assert str(refused.value) == reason


@pytest.mark.parametrize(
    ("seen", "named", "other"),
    [
        (ON_AN_ARM, "f feed", "p press"),
        (WITHOUT_ARM, "p press", "f feed"),
        (picture(), "p press", "f feed"),
    ],
)
def test_the_keys_name_the_feed_on_an_arm_and_the_weight_on_bit_elsewhere(seen, named, other):
    keys = keys_of(seen)
    assert keys.startswith(f" {named}  d drive  ")
    assert other not in keys
    assert len(keys.replace("  ", " ")) <= WIDTH


def test_the_question_that_the_drill_would_reject_names_the_other_key():
    assert "f commands the feed" in PROMPTS["press"].hint(ON_AN_ARM)
    assert "Enter presses" in PROMPTS["press"].hint(WITHOUT_ARM)
    assert "0 holds" in PROMPTS["feed"].hint(ON_AN_ARM)
    assert "p commands the weight on bit" in PROMPTS["feed"].hint(WITHOUT_ARM)


def test_each_question_has_a_key_of_its_own():
    keys = [prompt.key for prompt in PROMPTS.values()]
    assert len(set(keys)) == len(keys)
