"""Drills with slow processes give the bits that were written down, over configurations and faults.

``python test/simulation/test_process_bits.py`` prints the digests.
"""

import hashlib
import json

import pytest

from rpud_sim.simulation import Fault, Feed, Simulation, to_configuration
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.recent_energy import account_of

MILLISECOND = 1_000_000
LAYERS = [
    {"depth_from": 0.0, "rock": "regolith"},
    {"depth_from": 4e-4, "rock": "chalk"},
    {"depth_from": 1e-3, "rock": "sandstone", "threshold_energy": 1e-5},
]
STRATA = json.dumps({"layers": LAYERS, "bottom": 3e-3})
TURNS = {"rotation_model": "friction_drive"}
ARM = {"feed_model": "arm", "feed_rate_limit": 0.04, "initial_feed": 0.003}
DRILLS = {
    "rotation alone": TURNS,
    "rotation in one rock": {**TURNS, "rock_model": "specific_energy"},
    "strata without rotation": {"strata": STRATA},
    "rotation in strata": {**TURNS, "strata": STRATA, "bit_wear_rate": 1e-6},
    "arm": {**ARM, **TURNS, "strata": STRATA},
    "arm before drilling": {**ARM, "regime": "free", "initial_feed": 0.01},
    "rigid arm": {**ARM, **TURNS, "strata": STRATA, "arm_stiffness": 0.0, "arm_play": 2e-4},
    "slipping arm": {
        **ARM,
        **TURNS,
        "strata": "chalk",
        "arm_play": 2e-4,
        "anchoring_force": 6.0,
    },
    "resonance": {
        **ARM,
        **TURNS,
        "strata": "sandstone",
        "actuator_model": "resonance",
        "generator": "tracking",
        "heating": True,
    },
    "weak rotor": {
        **TURNS,
        "strata": "sandstone",
        "rotor_stall_torque": 0.02,
    },
}
KINDS = {
    "binding": None,
    "worn_bit": None,
    "hard_inclusion": 2e8,
    "corkscrewing": 0.005,
    "bit_walk": None,
    "choking": None,
    "hard_rock": None,
    "drill_tool_binding": None,
    "lost_preload": None,
    "feed_stall": None,
    "arm_slip": None,
    "load_spring_binding": None,
    "free_mass_jammed": None,
}
FEEDS = (Feed("rate", 0.01), Feed("rate", -0.02), Feed("rate", 0.03), Feed("position", 0.006))
PITCHES = (400_000, 20 * MILLISECOND, MILLISECOND)
EXPECTED = {
    "rotation alone": "b8e043f9fb94f9b4",
    "rotation in one rock": "66ec1421c6075cee",
    "strata without rotation": "629fcda9259115b8",
    "rotation in strata": "154873f426eedb42",
    "arm": "7396eda4b38230f5",
    "arm before drilling": "31628024533817fc",
    "rigid arm": "75ad85ef8443a8f8",
    "slipping arm": "91f537a35e76eb5a",
    "resonance": "d291cf957b9ca92a",
    "weak rotor": "3f356c95a8e6df2f",
}


def drill(values, digest):
    """Drill under commands and faults, in blocks of several lengths; add all that comes of it."""
    simulation = Simulation(to_configuration(values), 0.3)

    def advance(duration, pitch):
        end = simulation.time + duration
        while simulation.time < end:
            block = simulation.advance_to(min(simulation.time + pitch, end))
            for records in (block.covering, block.impacts):
                for name in records.dtype.names:  # not the bytes between fields
                    digest.update(records[name].tobytes())
            states = (block.process, block.feed, block.actuator, account_of(block))
            digest.update(repr(states).encode())
            values = (simulation.depth, simulation.penetration_rate, simulation.weight_on_bit)
            digest.update(repr(values).encode())

    fed = simulation.configuration.has_feed
    advance(120 * MILLISECOND, 10 * MILLISECOND)
    simulation.apply(Feed("rate", 0.006) if fed else WeightOnBit(14.0))
    advance(180 * MILLISECOND, 7_300_000)
    honoured = simulation.supported_kinds()
    for number, kind in enumerate(kind for kind in KINDS if kind in honoured):
        given = {} if KINDS[kind] is None else {"magnitude": KINDS[kind]}
        simulation.inject(Fault(kind, **given), 60 * MILLISECOND)
        if fed:
            simulation.apply(FEEDS[number % 4])
        advance(47 * MILLISECOND, PITCHES[number % 3])
    simulation.apply(Drive(False, 100.0, 16000.0))
    advance(40 * MILLISECOND, 10 * MILLISECOND)
    simulation.apply(Drive(True, 70.0, 16000.0))
    for rate in (-0.04, 0.04):
        if fed:
            simulation.apply(Feed("rate", rate))
        advance(150 * MILLISECOND, 50 * MILLISECOND)


def digest_of(name):
    """Return the digest of a drill of ``DRILLS``."""
    digest = hashlib.sha256()
    drill(DRILLS[name], digest)
    return digest.hexdigest()[:16]


@pytest.mark.parametrize("name", DRILLS)
def test_the_bits_of_a_drill_with_slow_processes_stay(name):
    assert digest_of(name) == EXPECTED[name]


if __name__ == "__main__":
    for each in DRILLS:
        print(f'    "{each}": "{digest_of(each)}",')
