"""Named readings of the paper: each with the reasons for its choices."""

from __future__ import annotations

from rpud_sim.simulation import preset
from rpud_sim.studies.reproduction.choices import (
    IMPLIED,
    SHAPE_MASS,
    SHAPE_ON_SERIES,
    Before,
    Reading,
    Rock,
)

PRESETS = "presets"
REASONED = "springs in series"
AS_FIGURE_12 = "Fig. 12's tool"
AS_FIGURE_12_PRINTED_AMPLITUDE = "Fig. 12's tool, A as printed"
AS_FIGURE_12_FITTED = "Fig. 12's tool, fitted"

_HALF_AMPLITUDE = 17.5e-6  # 35 um read as peak to peak [m]

_BEFORE = Before(gravity=0.0, drill_tool_mass=SHAPE_MASS)
_BEFORE_REASONS = (
    "Before drilling: Table 1 as printed, A = 35 µm and both restitutions one.",
    "Before drilling: no gravity, because Table 1 has none, and no weight on bit.",
    "Before drilling: m_dt is 2.124 g in place of 13.5 g, the mass that the shape (24) gives the "
    "tool. That the paper's program used it in both sections is a guess.",
)
_DOUBT = (
    "35 µm fits before drilling, half of it in the rock. One amplitude for both does not fit both."
)
_IMPLIED_REASON = (
    "In the rock: mass and spring rate are the two that give both numbers of Fig. 12 by (21), (30) "
    "and (36)."
)

_drilling, _free = preset("drilling"), preset("free")

NAMED = (
    Reading(
        PRESETS,
        Before(gravity=_free.gravity, drill_tool_mass=_free.drill_tool_mass),
        Rock(weight_on_bit=_drilling.weight_on_bit, gravity=_drilling.gravity),
        (
            "Tables 1 and 2 with steel's modulus, earth's gravity, and 10 N as weight on bit, of "
            "which Table 2 has none.",
            "(22) and (27) as printed.",
        ),
    ),
    Reading(
        "tables as printed",
        Before(gravity=0.0),
        Rock(weight_on_bit=0.0, gravity=0.0, tool="printed, E printed"),
        (
            "Tables 1 and 2 to the letter: E_dt = 1.96e9 Pa, no gravity and no weight on bit, "
            "because the tables have none.",
        ),
    ),
    Reading(
        REASONED,
        _BEFORE,
        Rock(_HALF_AMPLITUDE, 1.0, 9.81, tool=SHAPE_ON_SERIES, energy="common"),
        (
            *_BEFORE_REASONS,
            "In the rock: the mass of the shape (24), 2.124 g, on two springs in series with "
            "steel, 4.748e7 N/m. No number is fitted.",
            f"In the rock: A = 17.5 µm, if 35 µm is peak to peak. {_DOUBT}",
            "In the rock: W = 9.81 N, the weight of the 1 kg RPUD that hangs on the tool.",
            "In the rock: the energy is that of the common motion after (21).",
        ),
    ),
    Reading(
        AS_FIGURE_12,
        _BEFORE,
        Rock(_HALF_AMPLITUDE, 0.9, 8.0, tool=IMPLIED),
        (
            *_BEFORE_REASONS,
            _IMPLIED_REASON,
            f"In the rock: A = 17.5 µm, if 35 µm is peak to peak. {_DOUBT}",
            "In the rock: W = 8 N and e_1 = 0.9 are fitted. Table 2 prints e_1 = 1 and no W.",
        ),
    ),
    Reading(
        AS_FIGURE_12_PRINTED_AMPLITUDE,
        _BEFORE,
        Rock(actuator_restitution=0.4, weight_on_bit=6.0, tool=IMPLIED),
        (
            *_BEFORE_REASONS,
            _IMPLIED_REASON,
            "In the rock: A = 35 µm as printed. W = 6 N and e_1 = 0.4 are fitted: a lower e_1 does "
            "much the same as a lower A, so these numbers hardly tell them apart.",
        ),
    ),
    Reading(
        AS_FIGURE_12_FITTED,
        _BEFORE,
        Rock(20e-6, 0.8, 8.0, tool=IMPLIED),
        (
            *_BEFORE_REASONS,
            _IMPLIED_REASON,
            "In the rock: A = 20 µm, W = 8 N and e_1 = 0.8 are round numbers near the best of the "
            "search. They are fitted, and nothing in the paper names them.",
        ),
    ),
)
