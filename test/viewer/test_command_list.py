"""Commands in words: each change is listed once, and what is left out is counted."""

from rpud_sim.viewer.commands import MOST_LOGGED, Commands

BEGIN = {
    "parameters": {
        "weight_on_bit": 8.0, "drive_enabled": True, "nominal_voltage": 100.0,
        "vibration_frequency": 16000.0, "rock_model": "none",
    }
}  # fmt: skip
FAULT = {"kind": "noise", "channel": "wrench", "magnitude": 0.3}


def begun():
    commands = Commands()
    commands.add(0.0, "begin", BEGIN)
    return commands


def texts(commands, faults=()):
    return [entry["text"] for entry in commands.frame(faults)["log"]]


def test_entries_are_told_in_words():
    commands = begun()
    for time, kind, content in (
        (1.0, "weight_on_bit", {"force": 12.5}),
        (2.0, "drive", {"enabled": True, "voltage": 120.0, "frequency": 20123.4}),
        (3.0, "drive", {"enabled": False, "voltage": 120.0, "frequency": 20123.4}),
        (4.0, "feed", {"mode": "rate", "value": 0.0015}),
        (5.0, "feed", {"mode": "rate", "value": 0.0}),
        (6.0, "feed", {"mode": "position", "value": 0.02}),
        (7.0, "configure", {"parameters": {**BEGIN["parameters"], "rock_model": "energy"}}),
        (8.0, "inject", {"fault": FAULT, "duration": 0}),
        (9.0, "flush", {}),
        (11.0, "end", {}),
    ):
        commands.add(time, kind, content)
    assert texts(commands) == [
        "a run begins",
        "weight on bit 12.5 N",
        "drive 120 V at 20.1234 kHz",
        "drive off",
        "feed at 1.5 mm/s",
        "feed holds",
        "feed to 20 mm",
        "parameters: rock_model energy",
        "noise on wrench 300 mN begins",
        "the drill stops",
    ]
    kinds = [entry["kind"] for entry in commands.frame()["log"]]
    assert kinds == ["run", *["command"] * 7, "fault", "run"]


def test_a_command_that_changes_nothing_is_not_told():
    commands = begun()
    for number in range(100):
        commands.add(1.0 + 0.05 * number, "weight_on_bit", {"force": 9.0})
    assert texts(commands) == ["a run begins", "weight on bit 9 N"]
    steps = commands.steps(0.0, 10.0, 100)["weight_on_bit"]
    assert (steps["t"].tolist(), steps["v"].tolist()) == ([0.0, 1.0], [8.0, 9.0])


def test_dense_changes_share_an_entry_that_counts_them_and_are_all_steps():
    commands = begun()
    for number in range(200):
        commands.add(1.0 + 0.05 * number, "weight_on_bit", {"force": 10.0 + number % 3})
    assert len(texts(commands)) == 5
    assert texts(commands)[-1] == "weight on bit \N{MULTIPLICATION SIGN}197, last 11 N"
    assert len(commands.steps(0.0, 100.0, 1000)["weight_on_bit"]["t"]) == 201
    part = commands.steps(2.02, 3.0, 5)["weight_on_bit"]
    assert len(part["t"]) == 5
    assert part["t"][0] <= 2.02


def test_faults_of_the_drill_take_the_place_of_those_of_the_journal():
    commands = begun()
    commands.add(8.0, "inject", {"fault": FAULT, "duration": 0})
    faults = [{**FAULT, "number": 2, "onset": 8.0, "end": 9.5}]
    assert texts(commands, faults)[1:] == ["fault 2: noise on wrench 300 mN begins", "fault 2 ends"]


def test_what_is_left_out_is_counted():
    commands = begun()
    for number in range(5000):
        commands.add(2.0 * number, "weight_on_bit", {"force": float(number % 7)})
    frame = commands.frame()
    assert len(frame["log"]) == MOST_LOGGED
    assert len(frame["log"]) + frame["log_thinned"] == 5001
    assert frame["log"][-1]["time"] == 2.0 * 4999
    times = [entry["time"] for entry in frame["log"]]
    assert times == sorted(times)


def test_what_another_program_wrote_is_named_and_harms_nothing():
    commands = begun()
    for content in ([], None, {"force": "much"}, {"force": []}):
        commands.add(1.0, "weight_on_bit", content)
        commands.add(2.0, "flush", content)
    commands.add(3.0, "new_thing", {})
    assert texts(commands) == ["a run begins", "weight_on_bit", "new thing"]
    commands.add(4.0, 100_000 * "long", {})
    assert max(map(len, commands._last)) == len(texts(commands)[-1]) == 160
