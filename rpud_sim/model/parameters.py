"""Parameters of the impact dynamics, with the paper's two tables as their defaults."""

from __future__ import annotations

import dataclasses
from typing import Any

from rpud_sim.foundation.parameters import (
    ParameterGroup,
    choice,
    declarations,
    flag,
    number,
    quantities,
)
from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown_name

REGIMES = ("free", "drilling")
CONTACT_MODELS = ("printed", "rayleigh", "mode_shape", "given")


# The limits keep every closed form well inside the range of double precision; they are far beyond
# any drill of this kind.
@dataclasses.dataclass(frozen=True)
class Parameters(ParameterGroup):
    """All parameters of the model, in SI units; the defaults are Table 2 of the paper.

    The paper leaves three values open or misprints them: Table 2 gives no weight on bit (10 N
    here), the elastic modulus is printed as 1.96e9 Pa (steel's 1.96e11 Pa here), and gravity is
    not given.
    """

    rpud_mass: float = number(1.0, "kg", "mass of the RPUD, m_ud", 1e-12, 1e3)
    vibration_frequency: float = number(
        16000.0, "Hz", "frequency of the harmonic vibration, f_0", 100.0, 2e5
    )
    vibration_amplitude: float = number(
        35e-6, "m", "amplitude of the harmonic vibration, A_0", 0.0, 1e-3
    )
    rpud_damping_ratio: float = number(
        0.5, "", "damping ratio of the RPUD, xi_ud", 0.0, 1.0, below=True, changeable=True
    )
    load_spring_rate: float = number(
        2000.0,
        "N/m",
        "spring rate of the load spring, k_1",
        1e-3,
        1e7,
        changeable=True,
    )
    free_mass: float = number(5e-3, "kg", "mass of the free mass, m_fm", 1e-12, 10.0)
    drill_tool_mass: float = number(
        13.5e-3, "kg", "mass of the drill tool before drilling, m_dt", 1e-12, 100.0
    )
    drill_tool_damping_ratio: float = number(
        0.5,
        "",
        "damping ratio of the drill tool before drilling, xi_dt",
        0.0,
        1.0,
        below=True,
        changeable=True,
    )
    restoring_spring_rate: float = number(
        2000.0,
        "N/m",
        "spring rate of the restoring spring, k_2",
        1e-3,
        1e7,
        changeable=True,
    )
    actuator_restitution: float = number(
        1.0,
        "",
        "coefficient of restitution between actuator and free mass, e_1",
        0.0,
        1.0,
        changeable=True,
    )
    drill_tool_restitution: float = number(
        1.0,
        "",
        "coefficient of restitution between free mass and drill tool, e_2",
        0.0,
        1.0,
        changeable=True,
    )
    elastic_modulus: float = number(
        1.96e11, "Pa", "elastic modulus of the drill tool, E_dt", 1e3, 1e13
    )
    section_1_length: float = number(
        10e-3, "m", "length of part I of the drill tool, L_dt1", 1e-6, 10.0
    )
    section_1_area: float = number(
        7.8e-5, "m^2", "cross-sectional area of part I, A_dt1", 1e-12, 1.0
    )
    section_2_length: float = number(
        80e-3, "m", "length of part II of the drill tool, L_dt2", 1e-6, 10.0
    )
    section_2_area: float = number(
        2.0e-5, "m^2", "cross-sectional area of part II, A_dt2", 1e-12, 1.0
    )
    drill_tool_density: float = number(
        7.9e3, "kg/m^3", "density of the drill tool, rho_dt", 1e-12, 1e5
    )
    weight_on_bit: float = number(
        10.0, "N", "weight on bit, preload of the load spring, W", 0.0, 1e3
    )
    gravity: float = number(
        9.81,
        "m/s^2",
        "acceleration of gravity along the drill axis, toward the rock, g",
        0.0,
        100.0,
        changeable=True,
    )
    gravity_on_drill: bool = flag(
        False, "whether gravity acts on the RPUD as well, not on the free mass alone"
    )
    contact_model: str = choice(
        "printed",
        CONTACT_MODELS,
        "effective mass and spring rate of the drill tool in the rock: (22) and (27) as printed, "
        "two springs in series, the shape of (24) in both, or given",
    )
    effective_tool_mass: float = number(
        1.72e-3,
        "kg",
        "effective mass of the drill tool with contact_model = given, m_eff,dt",
        1e-12,
        100.0,
    )
    effective_tool_spring_rate: float = number(
        5.28e7,
        "N/m",
        "effective spring rate of the drill tool with contact_model = given, k_eff,dt",
        1e-3,
        1e12,
    )
    regime: str = choice(
        "drilling", REGIMES, "free is before drilling, drilling is in the rock", changeable=True
    )

    def replace(self, **changes: Any) -> Parameters:
        """Return a copy with some values changed."""
        for name in changes:
            if name not in NAMES:
                raise ParameterError(
                    f"{shown_name(name)} is not a parameter; {did_you_mean(name, NAMES)}"
                )
        return dataclasses.replace(self, **changes)


NAMES: tuple[str, ...] = tuple(declarations(Parameters))
QUANTITIES = quantities(Parameters)


def preset(regime: str) -> Parameters:
    """Return the paper's parameters for a regime.

    ``free`` is Table 1 (no weight on bit); ``drilling`` is Table 2 with 10 N.
    """
    declarations(Parameters)["regime"].allowed.check("regime", regime)
    return Parameters(regime="free", weight_on_bit=0.0) if regime == "free" else Parameters()
