"""What holds for every trajectory, whatever the drill, its commands and its changes."""

import numpy as np
from trajectories import evaluate

from rpud_sim.model.segment import EVENT_ACTUATOR_IMPACT
from rpud_sim.model.tolerances import LOWEST_BOUNCE, SAME_VELOCITY, TOUCHING

MOST_SEGMENTS = 5000


def check_trajectory(segments):
    """Bodies in order, time without gaps, and motions that only contacts and the rock jolt."""
    segments = segments[:MOST_SEGMENTS]
    index = np.arange(len(segments))
    for share in np.linspace(0.0, 1.0, 20):
        now = evaluate(segments, index, share * segments["duration"])
        digits = 1e-15 * (abs(now["nodal_plane_position"]) + abs(segments["nodal_plane_offset"]))
        ahead = now["free_mass_position"] - now["actuator_position"]
        assert (ahead > -1.01 * TOUCHING - digits).all()
        ahead = now["drill_tool_displacement"] - now["free_mass_position"]
        assert (ahead > -1.01 * TOUCHING - digits).all()
    step = np.diff(segments["start_seconds"]) + np.diff(segments["start_fraction"])
    assert abs(step - segments["duration"][:-1]).max(initial=0.0) < 1e-15
    old = evaluate(segments, index[:-1], segments["duration"][:-1])
    new = evaluate(segments, index[1:], np.zeros(len(index) - 1))
    jump = {name: abs(new[name] - old[name]) for name in old}
    offsets = abs(segments["nodal_plane_offset"][:-1]) + abs(segments["nodal_plane_offset"][1:])
    digits = 1e-15 * (abs(new["nodal_plane_position"]) + offsets)
    assert (jump["nodal_plane_position"] < 1e-14 + digits).all()
    # Whatever changes, the phase goes on, and the amplitude changes at zero displacement.
    assert (jump["actuator_position"] < 1e-13 + digits).all()
    assert (jump["free_mass_position"] < 1.01 * LOWEST_BOUNCE).all()
    # In the rock the drill tool is at rest at zero as soon as it is left alone.
    let_go = (segments["contact"][1:] & 2 == 0) & (new["drill_tool_displacement"] == 0.0)
    assert (jump["drill_tool_displacement"][~let_go] < 1.01 * LOWEST_BOUNCE).all()
    struck = segments["event"][1:] & EVENT_ACTUATOR_IMPACT != 0
    assert (jump["nodal_plane_velocity"][~struck] < 2 * SAME_VELOCITY).all()
