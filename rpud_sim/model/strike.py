"""Search for the meetings of the free mass: the engine's most frequent ones.

They make steps within which the bodies cannot meet (steps.py), from bounds that only these gaps
have. The tip's vibration bends the gap by Omega^2 A sin(phi), of which the least up to another
phase is known. The swing of the drill tool dies away, and with it the bounds on its derivatives.
"""

import math

from rpud_sim.model import steps
from rpud_sim.model.closed_form import (
    NO_SWING,
    TWO_PI,
    DecayingSinCos,
    PhaseSinCos,
    decaying_amplitude,
    swinging_part,
    undamped_frequency,
)
from rpud_sim.model.compile import compiled
from rpud_sim.model.elementary import exponential, sin_cos
from rpud_sim.model.segment import (
    drill_tool_motion,
    drill_tool_swing,
    fall,
    nodal_plane_motion,
    nodal_plane_swing,
    vibration_turn,
)
from rpud_sim.model.tolerances import LONGEST_SEARCH, TOUCHING

# Where the envelope allows a longer step than this, the vibration is not computed [cycles].
_LONG = 0.5

# Phases up to which the least bend of the vibration is taken from its current one, and as zero: it
# is not less up to the phase as far on the other side of its crest, and to its middle [cycles].
_RISING = 0.2
_FALLING = 0.45

# Angle omega_n s within which a decaying swing is the first five terms of its series [rad]. The
# next term is less than 3e-16 of the swing, and in its rate less than 1e-12 of the greatest rate.
_SHORT = 2e-3
_SIXTH = 1.0 / 6.0

# Angle within which the sine is the first five terms of its series, and the cosine too; the next
# one is less than 3e-17 [rad].
_NEAR = 0.1

# Added and subtracted, it rounds to the nearest whole number.
_ROUND = 6755399441055744.0  # 1.5 * 2**52


@compiled
def _vibrating_step(value, slope, sine, cycles, period, peak, slow_second):
    """Return the ``Step`` of a gap that a vibrating tip bends, by at most ``peak`` = Omega^2 A.

    ``sine`` is the sine of the vibration's phase ``cycles``, ``slow_second`` bounds all else that
    bends.
    """
    # From -1/4 to 3/4, so that the sine rises up to 1/4 and falls from there on.
    phase = cycles - ((cycles - 0.25 + _ROUND) - _ROUND)
    present = peak * sine
    is_rising = phase < _RISING
    is_falling = phase < _FALLING
    bend = (present if is_rising else (0.0 if is_falling else -peak)) - slow_second
    span = 0.5 - (2.0 * phase if is_rising else phase)
    limit = span * period if is_falling else math.inf
    time = steps.safe_step(value, slope, bend)
    if time > limit:
        return steps.Step(limit, False)
    most = min(present + TWO_PI / period * peak * time, peak) + slow_second
    return steps.Step(time, steps.ends_at_root(value, slope, time, bend, most))


@compiled
def soon_after(square, damping, displacement, velocity, time):
    """Decaying part and its rate soon after by their series; omega_n^2 and 2 a are given."""
    second = -square * displacement - damping * velocity
    third = -square * velocity - damping * second
    fourth = -square * second - damping * third
    square_of_time = time * time
    last = 0.5 * second + time * (_SIXTH * third)
    after = (displacement + time * velocity) + square_of_time * (
        last + square_of_time * (0.25 * _SIXTH * fourth)
    )
    last = 0.5 * third + time * (_SIXTH * fourth)
    return after, (velocity + time * second) + square_of_time * last


@compiled
def turned_by(turn, angle):
    """``PhaseSinCos`` after an angle of at most _NEAR [rad], by the series of sine and cosine."""
    z = angle * angle
    w = z * z
    sine = angle + angle * z * (
        (-1.0 / 6.0 + z * (1.0 / 120.0)) + w * (-1.0 / 5040.0 + z * (1.0 / 362880.0))
    )
    less = z * ((0.5 - z * (1.0 / 24.0)) + w * (1.0 / 720.0 - z * (1.0 / 40320.0)))
    return PhaseSinCos(
        turn.sine + (turn.cosine * sine - turn.sine * less),
        turn.cosine - (turn.sine * sine + turn.cosine * less),
    )


@compiled
def first_strike(segment, limit, turn):
    """Find when the actuator strikes the free mass, which does not touch it, as ``first_root``."""
    frequency = segment.vibration_frequency
    amplitude = segment.vibration_amplitude
    omega = TWO_PI * frequency
    peak = omega * omega * amplitude
    nodal_plane = nodal_plane_motion(segment)
    rate = undamped_frequency(nodal_plane)
    square = rate * rate
    damping = 2.0 * nodal_plane.decay_rate
    short = _SHORT / rate
    slow_second = square * decaying_amplitude(nodal_plane)
    slow_third = rate * slow_second
    gravity = segment.free_mass_acceleration
    in_flight = segment.contact == 0
    tool = drill_tool_motion(segment)
    if in_flight:
        slow_second += gravity
        u_fm, v_fm = segment.free_mass_position, segment.free_mass_velocity
    else:
        tool_rate = undamped_frequency(tool)
        slow_second += tool_rate * tool_rate * decaying_amplitude(tool)
        displacement, v_fm = swinging_part(tool, NO_SWING)
        u_fm = tool.offset + displacement
    slow_second = max(slow_second, steps.LEAST_BOUND)
    displacement, velocity = swinging_part(nodal_plane, NO_SWING)
    period = 1.0 / frequency
    long = _LONG * period
    allowance = TOUCHING
    time = 0.0
    turned = 0.0
    for number in range(LONGEST_SEARCH):
        slow = u_fm - nodal_plane.offset - displacement
        slow_slope = v_fm - velocity
        envelope = slow - amplitude
        left = limit - time
        met = False
        if steps.is_clear(envelope, slow_slope, slow_second, left):
            return limit, False, number + 1
        if steps.is_clear(envelope, slow_slope, slow_second, long):
            allowance = 0.0
            curvature = -slow_second
            if in_flight:
                curvature = gravity + square * displacement + damping * velocity
            reach = min(steps.safe_step(envelope, slow_slope, curvature), left)
            bend = max(curvature - slow_third * reach, -slow_second)
            step = steps.Step(min(steps.safe_step(envelope, slow_slope, bend), reach), False)
        else:
            angle = omega * (time - turned)
            turned = time
            turn = turned_by(turn, angle) if angle < _NEAR else vibration_turn(segment, time)
            value = slow - amplitude * turn.sine
            slope = slow_slope - omega * amplitude * turn.cosine
            if allowance > 0.0 and steps.is_above(value, slope, peak + slow_second, allowance):
                allowance = 0.0
            value += allowance
            cycles = segment.vibration_phase + frequency * time
            step = _vibrating_step(value, slope, turn.sine, cycles, period, peak, slow_second)
            step = steps.at_least(step, slope, 0.0)
            met = steps.is_root(value, slope, step)
            # Beyond the vibration's reach already, and up to the limit.
            ahead = envelope + step.time * (slow_slope - 0.5 * slow_second * step.time)
            slower = slow_slope - slow_second * step.time
            if not met and steps.is_clear(ahead, slower, slow_second, left - step.time):
                return limit, False, number + 1
        time, outcome = steps.after_step(time, step, met, limit)
        if outcome != steps.RUNNING:
            return time, outcome == steps.MET, number + 1
        if in_flight and step.time < short:
            displacement, velocity = soon_after(square, damping, displacement, velocity, step.time)
        else:
            swing = nodal_plane_swing(segment, time)
            displacement, velocity = swinging_part(nodal_plane, swing)
        if in_flight:
            u_fm, v_fm = fall(segment.free_mass_position, segment.free_mass_velocity, gravity, time)
        else:
            u_dt, v_fm = swinging_part(tool, drill_tool_swing(segment, time))
            u_fm = tool.offset + u_dt
    return time, False, LONGEST_SEARCH


@compiled
def first_landing(segment, limit):
    """Find when the free mass in free motion meets the moving drill tool, as ``first_root``."""
    tool = drill_tool_motion(segment)
    rate = undamped_frequency(tool)
    gravity = segment.free_mass_acceleration
    amplitude = decaying_amplitude(tool)
    square = rate * rate
    damping = 2.0 * tool.decay_rate
    short = _SHORT / rate
    second = square * amplitude
    decay = 1.0
    last, _ = fall(segment.free_mass_position, segment.free_mass_velocity, gravity, limit)
    displacement, velocity = swinging_part(tool, NO_SWING)
    u_fm, v_fm = segment.free_mass_position, segment.free_mass_velocity
    allowance = TOUCHING
    time = 0.0
    for number in range(LONGEST_SEARCH):
        value = tool.offset + displacement - u_fm
        slope = velocity - v_fm
        curvature = -square * displacement - damping * velocity - gravity
        most = max(second * decay + gravity, steps.LEAST_BOUND)
        if allowance > 0.0 and steps.is_above(value, slope, most, allowance):
            allowance = 0.0
        value += allowance
        third = max(rate * second * decay, steps.LEAST_BOUND)
        step = steps.at_least(
            steps.step_with_curvature(value, slope, curvature, most, third), slope, 0.0
        )
        time, outcome = steps.after_step(time, step, steps.is_root(value, slope, step), limit)
        if outcome != steps.RUNNING:
            return time, outcome == steps.MET, number + 1
        # Its fall takes the free mass no further than it is at either end.
        if tool.offset - amplitude * decay > max(u_fm, last):
            return limit, False, number + 1
        if step.time < short:
            displacement, velocity = soon_after(square, damping, displacement, velocity, step.time)
        else:
            decay = exponential(-tool.decay_rate * time)
            sine, cosine = sin_cos(tool.angular_frequency * time)
            swing = DecayingSinCos(decay * cosine, decay * sine, decay * cosine - 1.0)
            displacement, velocity = swinging_part(tool, swing)
        u_fm, v_fm = fall(segment.free_mass_position, segment.free_mass_velocity, gravity, time)
    return time, False, LONGEST_SEARCH
