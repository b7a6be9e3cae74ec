"""Tolerances of the engine: how finely it resolves contacts.

Bodies may overlap by ``TOUCHING`` until they have been further apart, and a contact that begins
without force opens when it pulls by ``WEAKEST_PULL``: so bodies that neither press nor part cost
nothing. A gap that has been open and a contact that has pressed end at zero exactly, within
``TIME_RESOLUTION``.
"""

# Bodies that are nearer than this touch; they may overlap by as much before they collide [m].
TOUCHING = 1e-12

# A bounce that is lower is a contact that lasts, and so is a cage between actuator and drill tool
# that the free mass cannot force wider against what presses them together [m]. The energy that
# this takes or adds is less than the contact force times this length, each time.
LOWEST_BOUNCE = 1e-9

# Touching bodies do not collide if their velocities differ by less [m/s].
SAME_VELOCITY = 1e-9

# A free mass that meets the drill tool more slowly does not strike it [m/s]: what is reported ends
# when the drill is at rest.
SLOWEST_IMPACT = 1e-6

# A contact that does not press opens when it pulls by this [N]; it is kept if it pulls by less
# than half of that.
WEAKEST_PULL = 1e-9

# Touching bodies need no contact force if their accelerations close the gap by less [m/s^2].
SAME_ACCELERATION = 1e-6

# An approach that is this near to its root is an event [s].
TIME_RESOLUTION = 1e-14

# A slow drill tool in the rock that is nearer to zero is at rest there [m].
LEAST_DEFORMATION = 1e-14

# No segment is longer than this [s]: what is known ahead stays bounded, and bodies at rest are
# still reported.
LONGEST_SEGMENT = 0.01

# Steps of a search after which a segment ends without an event; the next one begins with tighter
# bounds.
LONGEST_SEARCH = 2000

# Collisions at one time after which the bodies move on together.
MOST_COLLISIONS = 1000

# The vibration of a resonance is steady when its amplitude is this near to its end, relatively, or
# LOWEST_BOUNCE near, and its phase is as near [cycles].
STEADY = 0.001
SAME_PHASE = 1e-4

# Updates of the amplitude of a resonance in one decay time, while it is not steady; more where it
# is smaller than what is missing to its end.
UPDATES_PER_DECAY = 40.0

# A vibration is followed in steps of a sixteenth of a cycle while it is smaller than so many times
# what half a cycle of the drive adds to it.
FINE = 8.0

# Such a step counts as this share of an event on the event budget.
SHARE_OF_STEP = 0.1

# Consecutive events within SHORTEST_SEGMENT [s] of each other after which the engine fails. Without
# this limit it would never return.
LONGEST_STANDSTILL = 10_000
SHORTEST_SEGMENT = 1e-13

# Events that one simulated second may have. A drill has a thousand to a hundred thousand. Bodies of
# a microgram have millions: a second of theirs would take minutes. A step of a search counts as
# STEP_EFFORT of an event. The effort falls by EVENT_BUDGET in a simulated second; the engine fails
# when it exceeds GREATEST_EFFORT.
EVENT_BUDGET = 5e5
STEP_EFFORT = 0.01
GREATEST_EFFORT = 1.5e6
