"""Drill in the rock by direct integration in small fixed steps: to compare the engine with.

It shares nothing with the engine but the constants. Every body has a position and a velocity in
the frame of the rock. RPUD, mount and vibration interact by their forces in every step.
"""

import math

import numpy as np
from numba import njit

from rpud_sim.model.drill import derive

STRIKE = 0.3  # m/s, from which on an impact on the drill tool counts
HARD = 0.05  # m/s, the same near stall
APART = 2e-6  # s, within which impacts count as one


@njit
def _cosine(cycles):
    return math.cos(2.0 * math.pi * (cycles - math.floor(cycles)))


@njit
def _follow_joined(m_fm, m_dt, k_dt, g, dt, u, v):
    """Move free mass and drill tool as one until their contact pulls: then the rock has the tool.

    Return position and velocity of both, and whether they are still joined.
    """
    a = (m_fm * g - k_dt * u) / (m_fm + m_dt)
    v += dt * a
    u += dt * v
    if g - a > 0.0:
        return u, v, u, v, True
    return u, v, 0.0, 0.0, False


@njit
def _meet_tool(m_fm, m_dt, e_2, in_rock, z, vz, t, vt):
    """Let a free mass that has reached the drill tool strike it.

    Return its position, both velocities, and whether they are joined: in the rock.
    """
    if z < t:
        return z, vz, vt, False
    if vz > vt and in_rock:
        v = (m_fm * vz + m_dt * vt) / (m_fm + m_dt)
        return t, v, v, True
    if vz > vt:
        impulse = (1.0 + e_2) * (vz - vt) / (1.0 / m_fm + 1.0 / m_dt)
        return t, vz - impulse / m_fm, vt + impulse / m_dt, False
    return t, vz, vt, False


@njit
def _follow_apart(m_dt, k_dt, c_dt, g, dt, in_rock, x, vx, z, vz, t, vt):
    """Move free mass and drill tool on their own; in the rock the tool rests.

    The tool hangs on a mount at x.
    """
    vz += dt * g
    z += dt * vz
    if not in_rock:
        vt += dt * (k_dt * (x - t) + c_dt * (vx - vt)) / m_dt
        t += dt * vt
    return z, vz, t, vt


@njit
def _integrate_arm(bodies, tool, arm, vibration, duration, dt, sample):
    m, k_1, c_1, m_fm, e_1, g = bodies
    m_eff, k_eff, m_dt, k_dt, c_dt, e_2 = tool
    k_a, c_a, feed, release = arm
    amplitude, frequency, phase = vibration
    omega = 2.0 * math.pi * frequency
    x = feed * k_a / (k_a + k_1)  # mount
    y, vy = -amplitude * _cosine(phase - 0.25), 0.0  # RPUD
    z, vz, t, vt = 0.0, 0.0, 0.0, 0.0  # free mass and drill tool
    in_rock, joined = True, False
    every = round(sample / dt)
    forces, work, reacting = np.zeros(round(duration / sample)), 0.0, 0.0
    for i in range(len(forces) * every):
        vx = (k_a * (feed - x) - k_1 * (x - y) + c_1 * vy) / (c_a + c_1)
        vy += dt * (k_1 * (x - y) + c_1 * (vx - vy)) / m
        y += dt * vy
        x += dt * vx
        forces[i // every] += k_a * (feed - x) / every
        reacting += dt * (k_1 * (x - y) + c_1 * (vx - vy))
        if in_rock and x < -release and y < -amplitude:
            in_rock = joined = False
        elif not in_rock and (x > 0.0 or y > -amplitude):
            in_rock, t, vt, z = True, 0.0, 0.0, min(z, 0.0)
        if joined:
            z, vz, t, vt, joined = _follow_joined(m_fm, m_eff, k_eff, g, dt, t, vt)
        else:
            z, vz, t, vt = _follow_apart(m_dt, k_dt, c_dt, g, dt, in_rock, x, vx, z, vz, t, vt)
        cycles = phase + frequency * i * dt
        tip = y + amplitude * _cosine(cycles - 0.25)
        v_tip = vy + omega * amplitude * _cosine(cycles)
        if z <= tip:
            z = tip
            if v_tip > vz:
                impulse = (1.0 + e_1) * (v_tip - vz) / (1.0 / m + 1.0 / m_fm)
                work += impulse * (v_tip - vy)
                vy -= impulse / m
                vz += impulse / m_fm
                joined = False
        if not joined:
            mass = m_eff if in_rock else m_dt
            z, vz, vt, joined = _meet_tool(m_fm, mass, e_2, in_rock, z, vz, t, vt)
    return forces, reacting / duration, work / duration


@njit
def _integrate_resonance(bodies, tool, resonance, start, silence, window, dt):
    m, k_1, c_1, m_fm, e_1, g = bodies
    in_rock, mass, k_eff, c_dt, e_2 = tool
    modal_mass, amplitude, decay_time, frequency = resonance
    omega = 2.0 * math.pi * frequency
    drive = 2.0 * amplitude * omega / decay_time
    weight, phase, begun, strike = start
    y, vy, z, vz, t, vt = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    # Without contacts the vibration would go on so: the drive feeds its velocity.
    q, p = begun * amplitude * _cosine(phase - 0.25), begun * amplitude * omega * _cosine(phase)
    y = -max(q, 0.0)
    joined = in_rock
    square, work, strikes, struck, apart = 0.0, 0.0, 0, -1, round(APART / dt)
    first, last = round(window[0] / dt), round(window[1] / dt)
    off, on = round(silence[0] / dt), round(silence[1] / dt)
    for i in range(last):
        push = 0.0 if off <= i < on else drive * _cosine(phase + frequency * i * dt)
        p += dt * (push - omega * omega * q - 2.0 / decay_time * p)
        q += dt * p
        vy += dt * (weight - k_1 * y - c_1 * vy) / m
        y += dt * vy
        if joined:
            z, vz, t, vt, joined = _follow_joined(m_fm, mass, k_eff, g, dt, t, vt)
        else:
            z, vz, t, vt = _follow_apart(mass, k_eff, c_dt, g, dt, in_rock, 0.0, 0.0, z, vz, t, vt)
        if z <= y + q:
            z = y + q
            closing = vy + p - vz
            if closing > 0.0:
                restitution = e_1 if closing > 1e-3 else 0.0
                impulse = (1.0 + restitution) * closing / (1.0 / m + 1.0 / modal_mass + 1.0 / m_fm)
                vy -= impulse / m
                if i >= first:
                    work += impulse * (p - 0.5 * impulse / modal_mass)
                p -= impulse / modal_mass
                vz += impulse / m_fm
                if joined:
                    if vz - vt > strike:
                        strikes += i >= first and i > struck + apart
                        struck = i
                    vz = vt = (m_fm * vz + mass * vt) / (m_fm + mass)
            if joined:
                t = max(t, z)
        if not joined:
            if z >= t and vz - vt > strike:
                strikes += i >= first and i > struck + apart
                struck = i
            z, vz, vt, joined = _meet_tool(m_fm, mass, e_2, in_rock, z, vz, t, vt)
        if i >= first:
            square += q * q
    seconds = (last - first) * dt
    return math.sqrt(2.0 * square / (last - first)), work / seconds, strikes / seconds


def _bodies(drill):
    restitution, gravity = drill.actuator_restitution, drill.gravity
    return (
        drill.rpud_mass,
        drill.load_spring_rate,
        drill.rpud_damping,
        drill.free_mass,
        restitution,
        gravity,
    )


def arm_figures(configuration, phase, duration, dt=1e-7):
    """Return the force of a compliant arm without play in each millisecond [N], and two means.

    They are of the reacting force [N] and of the actuator's power [W].
    """
    parameters, mount = configuration.parameters, configuration.mount
    drill, free = derive(parameters), derive(parameters.replace(regime="free"))
    tool = (drill.tool_mass, drill.tool_spring_rate, free.tool_mass, free.tool_spring_rate)
    tool += (free.tool_damping, free.drill_tool_restitution)
    arm = (mount.arm_stiffness, mount.arm_damping, mount.initial_feed, mount.contact_release)
    vibration = (parameters.vibration_amplitude, parameters.vibration_frequency, phase)
    return _integrate_arm(_bodies(drill), tool, arm, vibration, duration, dt, 1e-3)


def resonant_figures(
    configuration, phase, window, silence=(0.0, 0.0), dt=2e-8, begun=0.0, strike=STRIKE
):
    """Return root mean square amplitude [m], mechanical power [W] and impact rate [1/s].

    They are of a resonance in a window between two times [s]; its drive is off in the silence.
    It begins with a share of the unloaded vibration. Impacts slower than ``strike`` do not count,
    and those within ``APART`` count as one: a mass that comes to rest, or is hit on the tool, has
    many.
    """
    parameters, actuator = configuration.parameters, configuration.actuator
    drill, amplitude = derive(parameters), parameters.vibration_amplitude
    frequency = actuator.resonance_frequency
    decay_time = actuator.quality_factor / (math.pi * frequency)
    resonance = (actuator.modal_mass(amplitude), amplitude, decay_time, frequency)
    in_rock = parameters.regime == "drilling"
    tool = (in_rock, drill.tool_mass, drill.tool_spring_rate)
    tool += (drill.tool_damping, 0.0 if in_rock else drill.drill_tool_restitution)
    start = (parameters.weight_on_bit, phase, begun, strike)
    return _integrate_resonance(_bodies(drill), tool, resonance, start, silence, window, dt)
