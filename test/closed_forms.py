"""The motions of segments, written a second time in plain NumPy to check the engine against.

They follow the comment in Trajectory.msg and share no code with the package: ``segment`` gives the
values by the names of rpud_msgs/Trajectory, of one segment or of many. Each oscillation is the real
part of complex exponentials, so that a derivative is a factor.
"""

import numpy as np

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
