"""Trajectories as a reader of rpud_msgs/Trajectory sees them: rebuilt from the arrays alone."""

import numpy as np
from closed_forms import DRILL_TOOL, FREE_MASS, TIP, motion, nodal_plane

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
