"""Trajectories as a reader of rpud_msgs/Trajectory sees them: rebuilt from the arrays alone.

This follows the comment in Trajectory.msg and shares no code with the package.
"""

import numpy as np

CONSTANTS = (
    "load_spring_rate",
    "load_spring_damping",
    "free_mass",
    "drill_tool_mass",
    "drill_tool_spring_rate",
    "drill_tool_damping",
    "gravity",
)

NONE, ACTUATOR, DRILL_TOOL, BOTH = range(4)


def oscillation(arrays, body, index, s):
    """Give displacement, velocity and acceleration of a body's oscillation, without vibration."""
    offset, a, w, cosine, sine = (
        np.asarray(arrays[f"{body}_{name}"])[index]
        for name in ("offset", "decay_rate", "angular_frequency", "cosine", "sine")
    )
    decay = np.exp(-a * s)
    x = decay * (cosine * np.cos(w * s) + sine * np.sin(w * s))
    v = -a * x + w * decay * (sine * np.cos(w * s) - cosine * np.sin(w * s))
    return offset + x, v, -(a**2 + w**2) * x - 2 * a * v


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
    spring_rate, damping, free_mass, mass, tool_spring_rate, tool_damping, gravity = (
        np.asarray(arrays[name])[index] for name in CONSTANTS
    )
    contact = np.asarray(arrays["contact"])[index]
    frequency, amplitude, weight_on_bit, in_phase, in_quadrature = (
        np.asarray(arrays[name])[index]
        for name in (
            "vibration_frequency",
            "vibration_amplitude",
            "weight_on_bit",
            "nodal_plane_vibration_sine",
            "nodal_plane_vibration_cosine",
        )
    )
    omega = 2 * np.pi * frequency
    phase = 2 * np.pi * np.asarray(arrays["vibration_phase"])[index] + omega * s
    sine, cosine = np.sin(phase), np.cos(phase)

    u_np, v_np, a_np = oscillation(arrays, "nodal_plane", index, s)
    u_np = u_np + in_phase * sine + in_quadrature * cosine
    v_np = v_np + omega * (in_phase * cosine - in_quadrature * sine)
    a_np = a_np - omega**2 * (in_phase * sine + in_quadrature * cosine)
    u_ut = u_np + amplitude * sine
    v_ut = v_np + omega * amplitude * cosine
    a_ut = a_np - omega**2 * amplitude * sine

    u_dt, v_dt, a_dt = oscillation(arrays, "drill_tool", index, s)
    both = contact == BOTH
    u_dt, v_dt, a_dt = (
        np.where(both, tip, own) for tip, own in ((u_ut, u_dt), (v_ut, v_dt), (a_ut, a_dt))
    )

    start, speed, fall = (
        np.asarray(arrays[f"free_mass_{name}"])[index]
        for name in ("position", "velocity", "acceleration")
    )
    on_tip = (contact & ACTUATOR) != 0
    on_tool = contact == DRILL_TOOL
    u_fm = np.select([on_tip, on_tool], [u_ut, u_dt], start + speed * s + fall * s**2 / 2)
    v_fm = np.select([on_tip, on_tool], [v_ut, v_dt], speed + fall * s)

    # The free mass, or the drill tool, obeys Newton's law: that is the force between them.
    force = np.select(
        [both, on_tool],
        [
            mass * a_dt + tool_damping * v_dt + tool_spring_rate * u_dt,
            free_mass * (gravity - a_dt),
        ],
        0.0,
    )
    return {
        "nodal_plane_position": u_np,
        "nodal_plane_velocity": v_np,
        "actuator_position": u_ut,
        "actuator_velocity": v_ut,
        "free_mass_position": u_fm,
        "free_mass_velocity": v_fm,
        "drill_tool_displacement": u_dt,
        "drill_tool_velocity": v_dt,
        "contact_force": force,
        "reacting_force": weight_on_bit - spring_rate * u_np - damping * v_np,
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
