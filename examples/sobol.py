"""Which value of Table 2 decides a metric: Sobol indices by SALib (`pip install SALib`).

`python examples/sobol.py 256` uses 256 points of each matrix, a power of two (default 64).
"""

import sys

import pandas
from SALib.analyze import sobol
from SALib.sample import sobol as saltelli

import rpud_sim

METRICS = ("drill_tool_impact_rate", "contact_force_mean", "reacting_force_mean")
# "last digit" is half a unit of the last digit that Table 2 prints. Where it misprints a value or
# has none, and where zeros at the end may be rounding, 5 % are assumed.
INTERVALS = {
    "rpud_mass": (0.95, 1.05, "Table 2: 1000 g; assumed 5 %"),
    "vibration_frequency": (15200, 16800, "Table 2: 16000 Hz; assumed 5 %"),
    "vibration_amplitude": (34.5e-6, 35.5e-6, "Table 2: 35 um; last digit"),
    "rpud_damping_ratio": (0.45, 0.55, "Table 2: 0.5; last digit"),
    "load_spring_rate": (1900, 2100, "Table 2: 2000 N/m; assumed 5 %"),
    "free_mass": (4.5e-3, 5.5e-3, "Table 2: 5 g; last digit"),
    "actuator_restitution": (0.95, 1.0, "Table 2: 1; assumed 5 %, not above 1"),
    "elastic_modulus": (1.862e11, 2.058e11, "Table 2 misprints 1.96e9 Pa; steel, assumed 5 %"),
    "section_1_length": (9.5e-3, 10.5e-3, "Table 2: 10 mm; last digit"),
    "section_1_area": (7.75e-5, 7.85e-5, "Table 2: 7.8e-5 m^2; last digit"),
    "section_2_length": (79.5e-3, 80.5e-3, "Table 2: 80 mm; last digit"),
    "section_2_area": (1.95e-5, 2.05e-5, "Table 2: 2.0e-5 m^2; last digit"),
    "drill_tool_density": (7850, 7950, "Table 2: 7.9e3 kg/m^3; last digit"),
    "weight_on_bit": (9.5, 10.5, "not in Table 2; 10 N, assumed 5 %"),
}


def main(samples=64, duration=5.0):
    names = list(INTERVALS)
    bounds = [each[:2] for each in INTERVALS.values()]
    problem = {"num_vars": len(names), "names": names, "bounds": bounds}
    shares = saltelli.sample(problem, samples, calc_second_order=False, seed=0)
    points = pandas.DataFrame(shares, columns=names).assign(contact_model="printed")
    frame = rpud_sim.sweep(points, duration, seeds=2)
    for metric in METRICS:
        values = (
            frame[metric].to_numpy().reshape(-1, 2)
        )  # a row for each point, a column for each seed
        noise = values.var(axis=1, ddof=1).mean() / 2 / values.mean(axis=1).var()
        found = sobol.analyze(problem, values.mean(axis=1), calc_second_order=False, seed=0)
        unit = frame.attrs["units"][metric]
        print(f"{metric}: {values.mean():.4g} {unit}, share of the chaotic motion {noise:.2f}")
        # An index near the motion's share means nothing: use a longer duration or more seeds.
        for place in found["ST"].argsort()[:-4:-1]:
            alone, whole, error = (found[key][place] for key in ("S1", "ST", "ST_conf"))
            print(f"  {names[place]:20} alone {alone:5.2f}, in all {whole:5.2f} +- {error:.2f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
