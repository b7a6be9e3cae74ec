"""Topics are chosen by name, expression or namespace, or all; and excluded from any of these."""

import re

import pytest

from rpud_sim.ros.record.topic_selection import TopicSelection

NAMES = ("/rpud/status", "/rpud/deep/status", "/rpud/_hidden/status", "/other/clock", "/tf")


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ({}, {"/rpud/status", "/rpud/deep/status"}),
        ({"topics": ["/tf"]}, {"/tf"}),
        ({"topics": ["/rpud/_hidden/status"]}, {"/rpud/_hidden/status"}),
        ({"regex": "status$"}, {"/rpud/status", "/rpud/deep/status"}),
        ({"regex": "clock", "topics": ["/tf"]}, {"/other/clock", "/tf"}),
        ({"everything": True}, {"/rpud/status", "/rpud/deep/status", "/other/clock", "/tf"}),
        ({"everything": True, "regex": "clock"}, set(NAMES) - {"/rpud/_hidden/status"}),
        ({"exclude": "deep"}, {"/rpud/status"}),
        ({"everything": True, "exclude": "^/rpud"}, {"/other/clock", "/tf"}),
        ({"topics": ["/tf", "/rpud/status"], "exclude": "tf"}, {"/rpud/status"}),
    ],
)
def test_what_is_recorded(options, wanted):
    for key in options.keys() & {"regex", "exclude"}:
        options = options | {key: re.compile(options[key])}
    selection = TopicSelection(**options)
    assert {name for name in NAMES if selection.wants(name, "/rpud/")} == wanted


def test_only_names_can_be_complete():
    assert TopicSelection(["/tf"]).closed
    assert not TopicSelection().closed
    assert not TopicSelection(["/tf"], regex=re.compile("a")).closed
    assert not TopicSelection(["/tf"], everything=True).closed
