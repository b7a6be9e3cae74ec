"""The live line of `rpud run` in a real terminal, beside a drill that is jammed and refuses."""

import pytest
from pseudo_terminal import PseudoTerminal, without_steering

from rpud_sim.ros.client import DrillClient, RefusedError


@pytest.mark.extended
def test_faults_and_a_refusal_are_seen_and_the_line_never_wraps():
    words = ("--namespace", "/seen", "--set", "rock_model=specific_energy", "--set", "seed=1")
    with PseudoTerminal("rpud", "run", *words, TERM="xterm") as terminal:
        terminal.until(lambda: " on bit  " in terminal.text)
        with DrillClient("/seen", patience=30.0) as drill:
            try:
                drill.press(-5.0)
            except RefusedError as refusal:
                reason = str(refusal)
            drill.inject("free_mass_jammed")
            terminal.until(lambda: "  jammed  " in terminal.text)
            terminal.until(lambda: "  1 refused" in terminal.text)
            drill.pause()
            terminal.until(lambda: " paused  " in terminal.text)
        terminal.type("\x03")
        assert terminal.wait() == 0
        drawn = terminal.drawn.decode().replace("^C", "")  # which the terminal itself has drawn
    rows = [
        without_steering(part) for line in drawn.split("\r\n") for part in line.split("\r\x1b[K")
    ]
    refusals = [row for row in rows if "command refused" in row]
    assert len(refusals) == 1
    assert reason in refusals[0]
    assert "on bit" not in refusals[0]
    live = [row for row in rows if " N on bit" in row or "  1 refused" in row]
    assert live
    assert all(len(row) < 80 for row in live), live
    assert f"last refusal: {reason}" in drawn
    assert "fault 1: free_mass_jammed from " in drawn
