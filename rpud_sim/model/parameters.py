"""Parameters of the impact dynamics. Their defaults fit the paper's figures."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

from rpud_sim.foundation.quantities import (
    ParameterGroup,
    check_names,
    choice,
    declarations,
    flag,
    number,
    quantities,
)
from rpud_sim.model.contact_models import CONTACT_MODELS, CONTACT_MODELS_TEXT

REGIMES = ("free", "drilling")

changeable = functools.partial(number, changeable=True)  # while the drill runs


# The limits keep every closed form well inside the range of double precision; they are far beyond
# any drill of this kind.
@dataclasses.dataclass(frozen=True)
class Parameters(ParameterGroup):
    """All parameters of the model, in SI units; the defaults are the drill in the rock.

    They are Table 2 of the paper, save what it misprints, leaves open or contradicts: a comment
    names the source of each such value. ``config/tables_drilling.yaml`` is the table itself.
    """

    rpud_mass: float = number(1.0, "kg", "mass of the RPUD, m_ud", 1e-12, 1e3)
    vibration_frequency: float = number(
        16000.0, "Hz", "frequency of the harmonic vibration, f_0", 100.0, 2e5
    )
    vibration_amplitude: float = number(
        20e-6, "m", "amplitude of the harmonic vibration, A_0", 0.0, 1e-3
    )  # fitted; Table 2 prints 35 um
    rpud_damping_ratio: float = changeable(
        0.5, "", "damping ratio of the RPUD, xi_ud", 0.0, 1.0, below=True
    )
    load_spring_rate: float = changeable(
        2000.0, "N/m", "spring rate of the load spring, k_1", 1e-3, 1e7
    )
    free_mass: float = number(5e-3, "kg", "mass of the free mass, m_fm", 1e-7, 10.0)
    drill_tool_mass: float = number(
        2.124e-3, "kg", "mass of the drill tool before drilling, m_dt", 1e-12, 100.0
    )  # effective mass of the mode shape (24); Table 1 prints 13.5 g
    drill_tool_damping_ratio: float = changeable(
        0.5, "", "damping ratio of the drill tool before drilling, xi_dt", 0.0, 1.0, below=True
    )
    restoring_spring_rate: float = changeable(
        2000.0, "N/m", "spring rate of the restoring spring, k_2", 1e-3, 1e7
    )
    actuator_restitution: float = changeable(
        0.8, "", "coefficient of restitution between actuator and free mass, e_1", 0.0, 1.0
    )  # fitted; Table 2 prints 1
    drill_tool_restitution: float = changeable(
        1.0, "", "coefficient of restitution between free mass and drill tool, e_2", 0.0, 1.0
    )
    elastic_modulus: float = number(
        1.96e11, "Pa", "elastic modulus of the drill tool, E_dt", 1e3, 1e13
    )  # steel; Table 2 misprints 1.96e9
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
        8.0, "N", "weight on bit, preload of the load spring, W", 0.0, 1e3
    )  # fitted; Table 2 has none
    gravity: float = changeable(
        9.81,
        "m/s^2",
        "acceleration of gravity along the drill axis, toward the rock, g",
        0.0,
        100.0,
    )  # the earth's; the tables have none
    gravity_on_drill: bool = flag(
        False, "whether gravity also acts on the RPUD, not only on the free mass"
    )
    contact_model: str = choice(
        "given",
        CONTACT_MODELS,
        f"effective mass and spring rate of the drill tool in the rock: {CONTACT_MODELS_TEXT}",
    )  # Table 2 with (22) and (27) gives neither number of Fig. 12
    effective_tool_mass: float = number(
        1.72e-3,
        "kg",
        "effective mass of the drill tool with contact_model = given, m_eff,dt",
        1e-12,
        100.0,
    )  # Fig. 12 implies it by (21), (30) and (36)
    effective_tool_spring_rate: float = number(
        5.28e7,
        "N/m",
        "effective spring rate of the drill tool with contact_model = given, k_eff,dt",
        1e-3,
        1e12,
    )  # Fig. 12 implies it
    regime: str = choice(
        "drilling", REGIMES, "free is before drilling, drilling is in the rock", changeable=True
    )

    @property
    def tool_length(self) -> float:
        """Length of the drill tool, parts I and II [m]: no hole is deeper."""
        return self.section_1_length + self.section_2_length

    def replace(self, **changes: Any) -> Parameters:
        check_names(changes, NAMES)
        return dataclasses.replace(self, **changes)


NAMES: tuple[str, ...] = tuple(declarations(Parameters))
QUANTITIES = quantities(Parameters)


def preset(regime: str) -> Parameters:
    """Return the default parameters of a regime.

    ``drilling`` is the tool that Fig. 12 implies, with fitted amplitude, restitution and weight on
    bit. ``free`` is Table 1 with the drill tool's mass after (24).
    """
    declarations(Parameters)["regime"].allowed.check("regime", regime)
    if regime == "drilling":
        return Parameters()
    # As Table 1 prints it: it has neither weight on bit nor gravity.
    return Parameters(
        regime="free",
        vibration_amplitude=35e-6,
        actuator_restitution=1.0,
        weight_on_bit=0.0,
        gravity=0.0,
    )
