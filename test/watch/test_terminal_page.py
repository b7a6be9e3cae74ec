"""The page in a terminal: what a picture says stands in it, in 80 columns, and nothing steers."""

import dataclasses
import math
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.client.drill_finder import FoundDrill
from rpud_sim.watch.picture import (
    COLUMNS,
    CONNECTED,
    DONE,
    REFUSED,
    VANISHED,
    Connection,
    FaultView,
    Outcome,
    Picture,
    Series,
)
from rpud_sim.watch.terminal_course import (
    greatest,
    rate,
    recent,
)
from rpud_sim.watch.terminal_page import (
    HEIGHT,
    WIDTH,
    Face,
    list_of,
    outcome_text,
    page_of,
    plain,
)

PERIOD = 0.05
STATUS = {
    "state": "running",
    "regime": "drilling",
    "weight_on_bit": 12.5,
    "weight_on_bit_applied": 3.25,
    "drive_enabled": True,
    "drive_voltage": 100.0,
    "drive_frequency": 16000.0,
    "drive_applied": 0.0,
    "commands_lost": False,
    "commanders": 1,
    "vibration_amplitude": 35e-6,
    "resonance_frequency": 16000.0,
    "actuator_temperature": 293.15,
    "electrical_power": math.nan,
    "depth": 0.00321,
    "penetration_rate": 0.00032,
    "active_faults": 0,
    "actuator_power": 48.5,
    "weight_power": -0.001,
    "change_power": 0.0,
    "load_damper_power": 0.68,
    "collision_power": 0.01,
    "absorbed_power": 47.79,
    "stored_power": 0.02,
    "impacts": 1200,
    "commands_accepted": 4,
    "commands_rejected": 0,
    "deadlines_missed": 0,
    "messages_dropped": 0,
    "real_time_factor": 1.0,
    "lateness_max": 0.0013,
    "lag": 0.0,
}


def series(first=0, **columns):
    """Give a fast series of some columns; the others are empty."""
    length = len(next(iter(columns.values())))
    rows = np.full((length, len(COLUMNS)), np.nan)
    for name, values in columns.items():
        rows[:, COLUMNS.index(name)] = values
    return Series(first, PERIOD, COLUMNS, rows)


def picture(status=(), **changes):
    seen = Picture(
        "/rpud",
        Connection(CONNECTED, 0.0),
        time=4.0,
        status=MappingProxyType({**STATUS, **dict(status)}),
    )
    return dataclasses.replace(seen, **changes)


def text_of(*arguments):
    return "\n".join(map(plain, page_of(*arguments)))


def fault(number=1, kind="hard_rock", channel="", magnitude=2.0, end=None):
    return FaultView(number, kind, channel, magnitude, end is None, 1.5, end)


def test_it_has_commands_state_powers_and_timing_with_units():
    text = text_of(picture(), Face())
    assert text.splitlines()[0].startswith(" /rpud   running   drilling   4.0 s   x1.00")
    for part in (
        "12.5 N                since 3.250 s",
        "100 V 16000 Hz        since 0.000 s",
        "depth 3.21 mm, 0.320 mm/s   vibration 35.00 um   resonance 16000.0 Hz",
        "actuator 48.50 W   weight 0.00 W",
        "tool and rock 47.79 W   collisions 0.01 W   damper 0.68 W   stored 0.02 W",
        "1.3 ms late   lag 0.0 ms   0 deadlines missed   0 messages dropped",
        "4 commands accepted, 0 refused   no message lost",
        "no faults",
    ):
        assert part in text
    assert "electrical" not in text


def test_what_is_wrong_is_said():
    seen = picture(
        {
            "drive_enabled": False,
            "commands_lost": True,
            "commanders": 2,
            "commands_rejected": 3,
            "electrical_power": 61.0,
            "depth": math.nan,
        },
        lost=MappingProxyType({"waveform": 2, "contact_force": 5, "journal": 0}),
        refusals=(3, "force = nan N is not finite"),
    )
    text = text_of(seen, Face())
    for part in (
        "drive           off ",
        "Commands stopped arriving: the drill has made itself safe.",
        "2 publishers command at once",
        "4 commands accepted, 3 refused   7 messages lost: contact_force 5, waveform 2",
        "last refusal: force = nan N is not finite",
        "electrical 61.00 W",
    ):
        assert part in text
    assert "depth" not in text


def test_a_drill_that_is_gone_has_a_banner_and_its_last_values_stay():
    gone = Connection(VANISHED, 5.0, "the drill in /rpud is gone: it has left")
    _, banner, *rest = page_of(picture(connection=gone), Face())
    assert plain(banner) == " vanished: the drill in /rpud is gone: it has left"
    assert "reverse" in banner[0][1]
    assert any("12.5 N" in plain(line) for line in rest)
    nothing = Picture("/rpud", Connection("searching", 0.0, "no drill in /rpud yet"))
    assert "no drill in /rpud yet" in text_of(nothing, Face())


def test_faults_that_last_come_first_with_onset_and_end():
    seen = picture(
        faults=(
            fault(1, "off", "wrench", 0.0),
            *(fault(number, end=2.5) for number in (2, 3, 4, 5)),
            fault(6, "free_mass_jammed", magnitude=math.nan),
        )
    )
    lines = text_of(seen, Face()).splitlines()
    assert lines[1] == " The free mass is jammed: it strikes no more."
    start = lines.index(" faults: 2 now, 4 over")
    assert lines[start + 1] == " 6 free_mass_jammed  from 1.500 s on"
    assert lines[start + 2] == " 1 off on wrench  from 1.500 s on"
    assert lines[start + 3] == " 5 hard_rock  from 1.500 s to 2.500 s  magnitude 2"
    tall = text_of(seen, Face(height=40))
    assert tall.count("hard_rock") == 4


def test_outcomes_have_the_reason_whole():
    reason = f"a reason that {'is long and ' * 6}needs two lines"
    refused = Outcome(2, "press", MappingProxyType({"force": -5.0}), REFUSED, reason, 0.0)
    done = Outcome(1, "clear", MappingProxyType({"which": "all"}), DONE, "", 0.0)
    assert outcome_text(done) == "clear all: done"
    text = text_of(picture(outcomes=(done, refused), refusals=(1, reason)), Face())
    last = " ".join(text.splitlines()[-2:]).replace("    ", " ")
    assert last == f" > press -5.0: refused: {reason}"
    assert "last refusal" not in text  # it stands there already


def test_rates_and_forces_are_those_of_the_last_second_of_bins_that_are_over():
    bins = np.zeros(41)
    bins[:20] = 100.0  # long ago
    bins[20:40] = 2.0
    bins[40] = 1000.0  # not over yet
    forces = np.full(41, np.nan)
    forces[5], forces[30], forces[40] = 1e9, 6543.0, 1e9
    shown = series(impacts=bins, peak_force_max=forces)
    assert rate(recent(shown, "impacts"), PERIOD) == pytest.approx(40.0)
    assert greatest(recent(shown, "peak_force_max")) == 6543.0
    text = " ".join(text_of(picture(series=shown), Face()).split())
    assert "impacts 40 /s" in text
    assert "peak force 6543 N" in text
    assert "reacting force none" in text
    assert "reacting force no data" in " ".join(text_of(picture(), Face()).split())


HOSTILE = st.text(max_size=200)


@given(
    width=st.integers(20, 200),
    height=st.integers(1, 60),
    namespace=HOSTILE,
    reason=HOSTILE,
    kind=HOSTILE,
    numbers=st.floats(),
    connected=st.booleans(),
)
def test_nothing_from_outside_steers_the_terminal(
    width, height, namespace, reason, kind, numbers, connected
):
    seen = picture(
        {"weight_on_bit": numbers, "state": reason, "real_time_factor": numbers},
        namespace=namespace,
        connection=Connection(CONNECTED if connected else VANISHED, 0.0, reason),
        faults=(fault(kind=kind, channel=reason),),
        refusals=(2, reason),
        lost=MappingProxyType({kind: 3}),
        outcomes=(Outcome(1, "inject", MappingProxyType({"kind": kind}), REFUSED, reason, 0.0),),
    )
    for line in page_of(seen, Face(width, height)):
        assert printable(plain(line)) == plain(line)
    for line in list_of([FoundDrill(namespace, reason, kind, numbers, 2)], Face(width, height)):
        assert printable(plain(line)) == plain(line)


def test_it_fits_a_serial_console():
    busy = picture(
        {"commands_rejected": 10**6, "deadlines_missed": 10**6, "messages_dropped": 10**6},
        faults=tuple(fault(number) for number in range(1, 30)),
        refusals=(10**6, "x" * 300),
        outcomes=tuple(
            Outcome(number, "press", MappingProxyType({"force": 1.0}), DONE, "", 0.0)
            for number in range(1, 20)
        ),
    )
    lines = page_of(busy, Face())
    assert len(lines) == HEIGHT
    assert max(cell_len(plain(line)) for line in lines) <= WIDTH
    assert len(page_of(busy, Face(height=50))) == 50


ARM = {
    "mount": {
        "position": 0.0118,
        "feed": 0.0123,
        "rate": 2e-4,
        "force": 14.25,
        "weight_on_bit": 9.75,
        "in_contact": True,
        "slip": 0.0,
    },
    "rotation": {
        "angle": 9.0,
        "rate": 13.5,
        "torque": 0.0099,
        "drive_torque": 0.0101,
        "stalled": False,
    },
    "borehole": {
        "depth": 0.004,
        "penetration_rate": 2e-4,
        "layer": "sandstone",
        "specific_energy": 9e7,
        "packed_cuttings": 12e-9,
        "bit_wear": 0.25,
        "side_offset": 0.0,
    },
}
FED = {"feed_mode": 0, "feed_value": 2e-4, "feed_power": 2.5e-3}


def test_models_around_the_percussion_have_a_line_each_while_they_are_on():
    text = text_of(picture(FED, latest=ARM), Face())
    lines = text.splitlines()
    feed, rotation, rock = (
        next(each for each in lines if each.startswith(f" {name} "))
        for name in ("feed", "rotation", "rock")
    )
    assert "0.2 mm/s at 12.30 mm" in feed
    assert "arm 14.25 N   in contact" in feed
    assert "slip" not in feed
    assert "actuator 48.50 W   weight 0.00 W   feed 2.50 mW" in text
    assert "13.50 rad/s" in rotation
    assert "torque 9.90 mN m   drive 10.10 mN m" in rotation
    assert "sandstone" in rock
    assert "cuttings 12 mm3   wear 0.25" in rock
    assert "walked" not in rock
    assert max(map(len, lines)) <= WIDTH
    assert len(page_of(picture(FED, latest=ARM), Face())) == HEIGHT
    for topic, label in (("mount", "feed"), ("rotation", "rotation"), ("borehole", "rock")):
        others = {name: values for name, values in ARM.items() if name != topic}
        shown = text_of(picture(FED, latest=others), Face()).splitlines()
        assert not any(each.startswith(f" {label} ") for each in shown)


@pytest.mark.parametrize(
    ("topic", "values", "status", "said"),
    [
        ("rotation", {"stalled": True}, {}, "stalled"),
        ("borehole", {"side_offset": 3e-4}, {}, "walked 0.30 mm"),
        ("borehole", {"layer": ""}, {}, "broken through"),
        ("mount", {"in_contact": False}, {}, "no contact"),
        ("mount", {"slip": -2e-3}, {}, "slip -2.00 mm"),
        ("mount", {}, {"feed_mode": 1, "feed_value": -0.01}, "to -10 mm at 12.30 mm"),
        ("mount", {}, {"feed_value": 0.0}, "holds at 12.30 mm"),
    ],
)
def test_what_happens_on_an_arm_is_said(topic, values, status, said):
    latest = {**ARM, topic: {**ARM[topic], **values}}
    assert said in text_of(picture({**FED, **status}, latest=latest), Face())
