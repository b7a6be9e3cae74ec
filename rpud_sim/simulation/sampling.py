"""Samples of a trajectory: every channel at any time, exact."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.closed_form import (
    NO_SWING,
    TWO_PI,
    is_near,
    near_swing,
    reacting_force,
    swinging_part,
    turn_at,
)
from rpud_sim.model.compile import compiled
from rpud_sim.model.search import force_on_drill_tool
from rpud_sim.model.segment import (
    CONSTANTS,
    CONTACT_DRILL_TOOL,
    SEGMENT,
    drill_tool_motion,
    fall,
    motion_at,
    nodal_plane_motion,
)


@dataclasses.dataclass(frozen=True)
class Times:
    """Times since simulation time zero, each as whole seconds and a fraction from 0 to 1."""

    seconds: np.ndarray  # shape (n,), int64 [s]
    fraction: np.ndarray  # shape (n,) [s]

    @staticmethod
    def from_nanoseconds(nanoseconds: np.ndarray | int) -> Times:
        """Return the times given in integer nanoseconds, shape (n,)."""
        seconds, rest = np.divmod(np.atleast_1d(np.asarray(nanoseconds, np.int64)), SECOND)
        return Times(seconds, rest / SECOND)

    @staticmethod
    def from_grid(first: int, count: int, rate: int) -> Times:
        """Return the times of ``count`` samples from number ``first`` on, at a whole rate [Hz]."""
        seconds, rest = np.divmod(np.arange(first, first + count, dtype=np.int64), rate)
        return Times(seconds, rest / rate)


@dataclasses.dataclass(frozen=True)
class Samples:
    """All channels at the given times, each of shape (n,); SI units, positive toward the rock."""

    nodal_plane_position: np.ndarray
    nodal_plane_velocity: np.ndarray
    actuator_position: np.ndarray
    actuator_velocity: np.ndarray
    free_mass_position: np.ndarray
    free_mass_velocity: np.ndarray
    drill_tool_displacement: np.ndarray
    drill_tool_velocity: np.ndarray
    contact_force: np.ndarray
    reacting_force: np.ndarray
    in_contact: np.ndarray


# Channels of numbers, in the order in which the kernel fills them.
CHANNELS = tuple(field.name for field in dataclasses.fields(Samples) if field.name != "in_contact")


def join_samples(parts: Sequence[Samples]) -> Samples:
    """Return the samples of consecutive times, at least one part, as one."""
    if len(parts) == 1:
        return parts[0]
    names = [field.name for field in dataclasses.fields(Samples)]
    return Samples(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in names})


# The loops of free motion have no branches and few arrays each, so that a processor
# does several times together. What they compute is ``motion_at``, bit for bit.


@compiled
def _fill_swing(motion, times, positions, velocities):
    for i in range(len(times)):
        swing = near_swing(motion.decay_rate, motion.angular_frequency, times[i])
        displacement, velocities[i] = swinging_part(motion, swing)
        positions[i] = motion.offset + displacement


@compiled
def _fill_turns(phase, frequency, times, sines, cosines):
    for i in range(len(times)):
        sines[i], cosines[i] = turn_at(phase + frequency * times[i])


@compiled
def _fill_fall(position, velocity, gravity, times, positions, velocities):
    for i in range(len(times)):
        positions[i], velocities[i] = fall(position, velocity, gravity, times[i])


@compiled
def _fill_force(weight_on_bit, spring_rate, damping, positions, velocities, forces):
    for i in range(len(forces)):
        forces[i] = reacting_force(weight_on_bit, spring_rate, damping, positions[i], velocities[i])


@compiled
def _add_vibration(in_phase, in_quadrature, sines, cosines, positions):
    for i in range(len(sines)):
        positions[i] = positions[i] + in_phase * sines[i] + in_quadrature * cosines[i]


@compiled
def _add_rate(omega, in_phase, in_quadrature, sines, cosines, velocities):
    for i in range(len(sines)):
        velocities[i] += omega * (in_phase * cosines[i] - in_quadrature * sines[i])


@compiled
def _fill_sum(values, factor, terms, sums):
    for i in range(len(sums)):
        sums[i] = values[i] + factor * terms[i]


@compiled
def _fill_flight(segment, begin, end, channels):
    """Fill the channels from one time to another, in free motion near its start; given its times.

    The times are in the last row. The rows of the free mass hold sines and cosines of the vibration
    for a while.
    """
    u_np, v_np, u_ut, v_ut = channels[0], channels[1], channels[2], channels[3]
    u_fm, v_fm, u_dt, v_dt = channels[4], channels[5], channels[6], channels[7]
    u_np, v_np, u_ut, v_ut = u_np[begin:end], v_np[begin:end], u_ut[begin:end], v_ut[begin:end]
    u_fm, v_fm, u_dt, v_dt = u_fm[begin:end], v_fm[begin:end], u_dt[begin:end], v_dt[begin:end]
    row = channels[9]
    times = row[begin:end]
    motion, frequency = nodal_plane_motion(segment), segment.vibration_frequency
    omega, amplitude = TWO_PI * frequency, segment.vibration_amplitude
    _fill_turns(segment.vibration_phase, frequency, times, u_fm, v_fm)
    _fill_swing(motion, times, u_np, v_np)
    _add_vibration(motion.vibration_sine, motion.vibration_cosine, u_fm, v_fm, u_np)
    _add_rate(omega, motion.vibration_sine, motion.vibration_cosine, u_fm, v_fm, v_np)
    _fill_sum(u_np, amplitude, u_fm, u_ut)
    _fill_sum(v_np, omega * amplitude, v_fm, v_ut)
    gravity = segment.free_mass_acceleration
    position, velocity = segment.free_mass_position, segment.free_mass_velocity
    _fill_fall(position, velocity, gravity, times, u_fm, v_fm)
    tool = drill_tool_motion(segment)
    if tool.angular_frequency == 0.0:
        displacement, velocity = swinging_part(tool, NO_SWING)
        u_dt[:] = tool.offset + displacement
        v_dt[:] = velocity
    else:
        _fill_swing(tool, times, u_dt, v_dt)
    spring_rate, damping = segment.load_spring_rate, segment.load_spring_damping
    _fill_force(segment.weight_on_bit, spring_rate, damping, u_np, v_np, times)
    row = channels[8]
    row[begin:end] = 0.0


@compiled
def _fill_one(segment, i, channels):
    """Fill the channels at a time, which is in the last row."""
    time = channels[9, i]
    motion = motion_at(segment, time)
    for m in range(8):
        channels[m, i] = motion[m]
    force = 0.0
    if segment.contact & CONTACT_DRILL_TOOL:
        force, _ = force_on_drill_tool(segment, time)
    channels[8, i] = force
    channels[9, i] = reacting_force(
        segment.weight_on_bit,
        segment.load_spring_rate,
        segment.load_spring_damping,
        motion[0],
        motion[1],
    )


@compiled
def _fill(segments, firsts, lasts, cuts, seconds, fraction, channels, in_contact):
    times = channels[9]
    for k in range(len(firsts)):
        index = firsts[k]
        last = lasts[k]
        i = cuts[k]
        while i < cuts[k + 1]:
            while index < last:
                after = segments[index + 1]
                ahead = float(seconds[i] - after.start_seconds) + (
                    fraction[i] - after.start_fraction
                )
                if ahead < 0.0:
                    break
                index += 1
            segment = segments[index]
            after = segments[min(index + 1, last)]
            begin = i
            while i < cuts[k + 1]:
                if index < last and i > begin:
                    ahead = float(seconds[i] - after.start_seconds) + (
                        fraction[i] - after.start_fraction
                    )
                    if not ahead < 0.0:
                        break
                times[i] = float(seconds[i] - segment.start_seconds) + (
                    fraction[i] - segment.start_fraction
                )
                in_contact[i] = segment.contact & CONTACT_DRILL_TOOL != 0
                i += 1
            end = times[i - 1]
            motion, tool = nodal_plane_motion(segment), drill_tool_motion(segment)
            near = is_near(motion.decay_rate, motion.angular_frequency, end)
            near = near and is_near(tool.decay_rate, tool.angular_frequency, end)
            if segment.contact == 0 and near:
                _fill_flight(segment, begin, i, channels)
            else:
                for j in range(begin, i):
                    _fill_one(segment, j, channels)


def sample(segments: np.ndarray, times: Times) -> Samples:
    """Sample all channels of a trajectory.

    Times are ascending and not before the first segment; later than the last one's end continues
    its closed form.
    """
    firsts, lasts = np.zeros(1, np.int64), np.array([len(segments) - 1], np.int64)
    cuts = np.array([0, len(times.seconds)], np.int64)
    return sample_parts(segments, firsts, lasts, cuts, times)


def sample_parts(
    segments: np.ndarray, firsts: np.ndarray, lasts: np.ndarray, cuts: np.ndarray, times: Times
) -> Samples:
    """Sample all channels of a trajectory in n parts, each as if it were alone.

    So a time at a joint of two segments is sampled from the same one, however far the trajectory
    continues before and after its part. ``firsts`` and ``lasts`` number the first and the last
    segment of each part, shape (n,), int64. ``cuts`` are the number of the first time of each part,
    and the number of all times, shape (n + 1,).
    """
    count = len(times.seconds)
    channels = np.empty((len(CHANNELS), count))
    in_contact = np.empty(count, np.bool_)
    if count:
        # Always read-only and in one piece: a kernel is compiled again for another type of array.
        segments = segments.view()
        segments.flags.writeable = False
        parts = map(np.ascontiguousarray, (firsts, lasts, cuts))
        _fill(segments, *parts, times.seconds, times.fraction, channels, in_contact)
    channels.flags.writeable = False
    in_contact.flags.writeable = False
    return Samples(**dict(zip(CHANNELS, channels, strict=True)), in_contact=in_contact)


# Fields of a trajectory with a value for each segment; it holds the constants once.
SEGMENT_ARRAYS = tuple(name for name in SEGMENT.names or () if name not in CONSTANTS)


def to_segments(message: Any) -> np.ndarray:
    """Return the ``SEGMENT`` records that a ``rpud_msgs/Trajectory`` was made of, bit for bit."""
    count = len(message.duration)
    segments = np.zeros(count, SEGMENT)
    for name in SEGMENT_ARRAYS:
        values = getattr(message, name)
        if len(values) != count:
            raise ValueError(f"{name} has {len(values)} values, and duration {count}")
        segments[name] = values
    for name in CONSTANTS:
        segments[name] = getattr(message, name)
    return segments


def first_sample(segment: np.void, rate: int) -> int:
    """Number of the first sample at or after a segment's start, at a whole rate [Hz]."""
    return int(segment["start_seconds"]) * rate + math.ceil(float(segment["start_fraction"]) * rate)


def end_sample(segment: np.void, rate: int) -> int:
    """Number of the first sample at or after a segment's end, at a whole rate [Hz]."""
    end = float(segment["start_fraction"]) + float(segment["duration"])
    return int(segment["start_seconds"]) * rate + math.ceil(end * rate)
