"""Trajectories as a reader of rpud_msgs/Trajectory rebuilds them, and what holds for each.

The motions are written a second time in plain NumPy to check the engine against: they follow the
comment in Trajectory.msg and share no code with the package. ``segment`` gives the values by the
names of the message, of one segment or of many. Each oscillation is the real part of complex
exponentials, so that a derivative is a factor.
"""

import numpy as np

from rpud_sim.model.segment import EVENT_ACTUATOR_IMPACT
from rpud_sim.model.tolerances import LOWEST_BOUNCE, SAME_VELOCITY, TOUCHING

TIP, FREE_MASS, DRILL_TOOL = "tip", "free mass", "drill tool"


def _decaying(segment, body, times, order):
    rate = -segment[f"{body}_decay_rate"] + 1j * segment[f"{body}_angular_frequency"]
    start = segment[f"{body}_cosine"] - 1j * segment[f"{body}_sine"]
    part = np.real(start * rate**order * np.exp(rate * times))
    return part + (segment[f"{body}_offset"] if order == 0 else 0.0)


def _vibration(segment, sine, cosine, times, order):
    omega = 2.0 * np.pi * segment["vibration_frequency"]
    angle = omega * times + 2.0 * np.pi * segment["vibration_phase"]
    return np.real((cosine - 1j * sine) * (1j * omega) ** order * np.exp(1j * angle))


def nodal_plane(segment, times, order=0):
    """Position of the nodal plane, or a derivative of it."""
    sine, cosine = (segment[f"nodal_plane_vibration_{name}"] for name in ("sine", "cosine"))
    steady = _vibration(segment, sine, cosine, times, order)
    return _decaying(segment, "nodal_plane", times, order) + steady


def motion(segment, body, times, order=0):
    """Position of a body, or a derivative of it, at times after the start of segments."""
    contact = np.asarray(segment["contact"])
    tip = nodal_plane(segment, times, order)
    tip = tip + _vibration(segment, segment["vibration_amplitude"], 0.0, times, order)
    if body == TIP:
        return tip
    tool = np.where(contact == 3, tip, _decaying(segment, "drill_tool", times, order))
    if body == DRILL_TOOL:
        return tool
    position, velocity, acceleration = (
        segment[f"free_mass_{name}"] for name in ("position", "velocity", "acceleration")
    )
    free = (
        position + velocity * times + 0.5 * acceleration * times**2,
        velocity + acceleration * times,
        acceleration + 0.0 * times,
    )[order]
    return np.where(contact & 1, tip, np.where(contact & 2, tool, free))


def gap(segment, front, back, times, order=0):
    """Gap between two bodies, or a derivative of it."""
    return motion(segment, front, times, order) - motion(segment, back, times, order)


def finished(engine):
    """Segments and impacts that an engine has finished since it was last drained."""
    covering, impacts = engine.drain()
    return covering[:-1], impacts


CONSTANTS = (
    "load_spring_rate",
    "load_spring_damping",
    "free_mass",
    "drill_tool_mass",
    "drill_tool_spring_rate",
    "drill_tool_damping",
    "gravity",
)
BODIES = (TIP, FREE_MASS, DRILL_TOOL)
_OSCILLATION = ("offset", "decay_rate", "angular_frequency", "cosine", "sine")
NAMES = (
    *CONSTANTS,
    *("contact", "weight_on_bit"),
    *(f"vibration_{name}" for name in ("frequency", "amplitude", "phase")),
    *(f"nodal_plane_vibration_{name}" for name in ("sine", "cosine")),
    *(f"{body}_{name}" for body in ("nodal_plane", "drill_tool") for name in _OSCILLATION),
    *(f"free_mass_{name}" for name in ("position", "velocity", "acceleration")),
)


def locate(arrays, seconds, fraction):
    """Give for each time the segment that it falls in, and the time since that one's start."""
    starts = np.asarray(arrays["start_seconds"]), np.asarray(arrays["start_fraction"])
    # A float cannot hold a late time exactly, but two segments that it cannot tell apart it orders.
    index = np.searchsorted(starts[0] + starts[1], seconds + fraction, side="right") - 1
    return index, (seconds - starts[0][index]) + (fraction - starts[1][index])


def rebuild(arrays, seconds, fraction):
    """Give all channels of a trajectory at the given times, by name."""
    return evaluate(arrays, *locate(arrays, seconds, fraction))


def evaluate(arrays, index, s):
    """Give all channels at times `s` after the start of the segments numbered `index`, by name.

    `arrays` gives the segments' values, also their constants, by the names of rpud_msgs/Trajectory.
    """
    segment = {name: np.asarray(arrays[name])[index] for name in NAMES}
    plane, plane_rate = (nodal_plane(segment, s, order) for order in (0, 1))
    tip, mass, tool = ([motion(segment, body, s, n) for n in range(3)] for body in BODIES)
    # The free mass, or the drill tool, obeys Newton's law: that is the force between them.
    pushed = segment["drill_tool_mass"] * tool[2] + segment["drill_tool_damping"] * tool[1]
    pushed += segment["drill_tool_spring_rate"] * tool[0]
    carried = segment["free_mass"] * (segment["gravity"] - tool[2])
    return {
        "nodal_plane_position": plane,
        "nodal_plane_velocity": plane_rate,
        "actuator_position": tip[0],
        "actuator_velocity": tip[1],
        "free_mass_position": mass[0],
        "free_mass_velocity": mass[1],
        "drill_tool_displacement": tool[0],
        "drill_tool_velocity": tool[1],
        "contact_force": np.select(
            [segment["contact"] == 3, segment["contact"] == 2], [pushed, carried], 0.0
        ),
        "reacting_force": segment["weight_on_bit"]
        - segment["load_spring_rate"] * plane
        - segment["load_spring_damping"] * plane_rate,
    }


def arrays_of(messages):
    """Give the arrays of rpud_msgs/Trajectory messages that follow each other, for `evaluate`."""
    fields = messages[0].get_fields_and_field_types().items()
    names = [name for name, kind in fields if kind.startswith("sequence")]
    arrays = {
        name: np.concatenate([np.array(getattr(message, name)) for message in messages])
        for name in names
    }
    lengths = [len(message.duration) for message in messages]
    for name in CONSTANTS:
        arrays[name] = np.repeat([getattr(message, name) for message in messages], lengths)
    return arrays


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
