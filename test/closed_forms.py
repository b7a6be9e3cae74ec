"""The motions of a segment, written a second time in plain NumPy to check the engine against.

Each oscillation is the real part of complex exponentials, so that a derivative is a factor.
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
    """Position of a body, or a derivative of it, at times after the segment's start."""
    contact = int(segment["contact"])
    if body == TIP or (body == FREE_MASS and contact & 1) or contact == 3:
        vibration = _vibration(segment, segment["vibration_amplitude"], 0.0, times, order)
        return nodal_plane(segment, times, order) + vibration
    if body == DRILL_TOOL or contact & 2:
        return _decaying(segment, "drill_tool", times, order)
    position, velocity, acceleration = (
        segment[f"free_mass_{name}"] for name in ("position", "velocity", "acceleration")
    )
    if order == 0:
        return position + velocity * times + 0.5 * acceleration * times**2
    return velocity + acceleration * times if order == 1 else acceleration + 0.0 * times


def gap(segment, front, back, times, order=0):
    """Gap between two bodies, or a derivative of it."""
    return motion(segment, front, times, order) - motion(segment, back, times, order)
