"""Named sets of choices: each with the reasons for them."""

from __future__ import annotations

from validation.choices import IMPLIED, SHAPE_MASS, SHAPE_ON_SERIES, Before, Choices, Rock

TABLES = "tables with steel"
REASONED = "springs in series"
AS_FIGURE_12 = "Fig. 12's tool"
AS_FIGURE_12_PRINTED_AMPLITUDE = "Fig. 12's tool, A as printed"
FITTED = "Fig. 12's tool, fitted"
ONE_AMPLITUDE = "one A and e_1, Fig. 12's tool"
ONE_AMPLITUDE_IN_SERIES = "one A and e_1, springs in series"

_HALF_AMPLITUDE = 17.5e-6  # 35 um read as peak to peak [m]
_BEFORE = Before(drill_tool_mass=SHAPE_MASS)

_BEFORE_REASONS = (
    "Table 1 as printed: A = 35 µm, both restitutions are one, and neither gravity nor weight on "
    "bit, because the table has none.",
    "m_dt is 2.124 g in place of 13.5 g: the mass that the shape (24) gives the tool. That the "
    "paper's program used it in both sections is a guess.",
)
_HALF = "A = 17.5 µm, if 35 µm is peak to peak. Before drilling 35 µm fits, not half of it."
_SEARCHED = (
    "A, e_1 and g are the same before drilling and in the rock. A, e_1 and W are fitted: the best "
    "that a search found from 10 to 40 µm, 0.4 to 1 and 0 to 16 N."
)

NAMED = (
    Choices(
        TABLES,
        Before(gravity=9.81),
        Rock(weight_on_bit=10.0, gravity=9.81),
        (
            "config/tables_free.yaml and config/tables_drilling.yaml.",
            "Tables 1 and 2 with steel's modulus, earth's gravity, and 10 N as weight on bit, of "
            "which Table 2 has none; (22) and (27) as printed.",
        ),
    ),
    Choices(
        "tables as printed",
        Before(),
        Rock(weight_on_bit=0.0, gravity=0.0, tool="printed, E printed"),
        (
            "Tables 1 and 2 to the letter: E_dt = 1.96e9 Pa, no gravity and no weight on bit, "
            "because the tables have none.",
        ),
    ),
    Choices(
        REASONED,
        _BEFORE,
        Rock(_HALF_AMPLITUDE, 1.0, 9.81, tool=SHAPE_ON_SERIES, energy="common"),
        (
            *_BEFORE_REASONS,
            "No number is fitted. The tool has the mass of the shape (24) on two springs in series "
            "with steel.",
            _HALF,
            "W is the weight of the 1 kg RPUD that hangs on the tool.",
            "The energy is that of the common motion after (21).",
        ),
    ),
    Choices(
        AS_FIGURE_12,
        _BEFORE,
        Rock(_HALF_AMPLITUDE, 0.9, 8.0, tool=IMPLIED),
        (
            *_BEFORE_REASONS,
            "Mass and spring rate give both numbers of Fig. 12 by (21), (30) and (36).",
            _HALF,
            "W = 8 N and e_1 = 0.9 are fitted. Table 2 prints e_1 = 1 and no W.",
        ),
    ),
    Choices(
        AS_FIGURE_12_PRINTED_AMPLITUDE,
        _BEFORE,
        Rock(actuator_restitution=0.4, weight_on_bit=6.0, tool=IMPLIED),
        (
            *_BEFORE_REASONS,
            "The tool of Fig. 12, and A = 35 µm as printed.",
            "W = 6 N and e_1 = 0.4 are fitted. A lower e_1 does much the same as a lower A, so "
            "these numbers hardly tell them apart.",
        ),
    ),
    Choices(
        FITTED,
        _BEFORE,
        Rock(20e-6, 0.8, 8.0, tool=IMPLIED),
        (
            *_BEFORE_REASONS,
            "The default of each regime, config/free.yaml and config/drilling.yaml.",
            "The tool of Fig. 12. A = 20 µm, W = 8 N and e_1 = 0.8 are fitted round numbers; "
            "nothing in the paper names them.",
        ),
    ),
    Choices(
        ONE_AMPLITUDE,
        Before(30.6e-6, 0.43, 9.81),
        Rock(30.6e-6, 0.43, 5.7, tool=IMPLIED),
        (_SEARCHED,),
    ),
    Choices(
        ONE_AMPLITUDE_IN_SERIES,
        Before(33e-6, 0.67, 0.0, SHAPE_MASS),
        Rock(33e-6, 0.67, 5.7, 0.0, tool=SHAPE_ON_SERIES, energy="common"),
        (_SEARCHED,),
    ),
)
