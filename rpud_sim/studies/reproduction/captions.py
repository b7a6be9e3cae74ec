"""Captions of the figures: the paper's words, and the numbers that belong to each figure."""

# name: title, the paper's words, keys of the numbers to set beside them
CAPTIONS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "figure_03": (
        "Fig. 3: positions before drilling",
        "“impacts the drill tool approximately 260 times in 0.6 seconds … nearly 430 Hz”",
        ("free_impact_rate",),
    ),
    "figure_04": (
        "Fig. 4: the same, zoomed",
        "“In each oscillation cycle of the free mass, the end tip of the actuator experiences "
        "several cycles”",
        (),
    ),
    "figure_05": (
        "Fig. 5: reacting force before drilling",
        "“the average value of the reacting force is 5.8 N”; measured (Fig. 21): 5.2 N",
        ("free_reacting_force_mean",),
    ),
    "figure_08": (
        "Fig. 8: positions during drilling",
        "“impacts the drill tool approximately 282 times in 0.6 seconds … nearly 470 Hz”",
        ("drilling_impact_rate",),
    ),
    "figure_09": (
        "Fig. 9: the same, zoomed",
        "“the end tip of the actuator experiences several cycles for each oscillation cycle of the "
        "free mass”",
        (),
    ),
    "figure_10": (
        "Fig. 10: greatest contact force of each impact",
        "“the maximum transient contact force reaches approximately 2600 N”",
        ("drilling_contact_force_max",),
    ),
    "figure_11": (
        "Fig. 11: its distribution",
        "“most of the contact forces are distributed in the range from 400N to 2200N”",
        ("drilling_contact_force_low", "drilling_contact_force_high"),
    ),
    "figure_12": (
        "Fig. 12: a single collision at 5 m/s",
        "“the maximum contact force … reaches 1650 N and the maximum displacement is 42 µm”",
        ("contact_peak_force", "contact_peak_displacement"),
    ),
    "figure_13": (
        "Fig. 13: kinetic energy transferred to the drill tool",
        "“the kinetic energy transferred to the drill tool in 0.6 seconds reaches 12.4 J”",
        ("drilling_kinetic_energy",),
    ),
    "figure_14": (
        "Fig. 14: reacting force during drilling",
        "“the average value of the reacting force is 14 N”",
        ("drilling_reacting_force_mean",),
    ),
}

STUDY_CAPTIONS: dict[str, tuple[str, str]] = {
    "figure_15": (
        "Fig. 15: coefficient of restitution",
        "“the average contact force increases significantly … results in a decrease in the number "
        "of collisions per second. The kinetic energy … and reacting force increase”",
    ),
    "figure_16": (
        "Fig. 16: free mass",
        "“an increase in the contact force, the kinetic energy …, and reacting force … the number "
        "of collisions per second decreases”",
    ),
    "figure_17": (
        "Fig. 17: damping ratio of the RPUD",
        "Section IV: “little effect on the contact force … number of collisions per second and the "
        "kinetic energy … increase … a decrease in the average reacting force”. Abstract: contact "
        "force and kinetic energy “can be enhanced by … decreasing the damping ratio”. Conclusion: "
        "“increasing the damping ratio … contributes to increases in both the contact force and "
        "the kinetic energy”",
    ),
    "figure_18": (
        "Fig. 18: weight on bit",
        "Section IV: “little effect on the contact force … number of collisions per second, the "
        "kinetic energy …, and the reacting force increase”. Abstract and conclusion: the contact "
        "force increases as well",
    ),
}
