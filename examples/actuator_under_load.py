"""Prints how the load of the impacts changes a resonant actuator, in each regime."""

import numpy as np

from rpud_sim.simulation import Beginning, Plan, Run, to_settings

for regime in ("free", "drilling"):
    for generator in ("fixed", "tracking"):
        values = {"regime": regime, "actuator_model": "resonance", "generator": generator}
        run = Run(Plan(Beginning(to_settings(values))), wanted=None)
        run.finish(500_000_000)
        found = []
        for time in range(501, 2501):
            run.finish(time * 1_000_000)
            now = run.simulation.actuator
            found.append((now.amplitude * 1e6, now.phase, now.frequency))
        amplitude, phase, frequency = np.mean(found, axis=0)
        drawn, work = now.electrical_energy / 2.5, now.mechanical_work / 2.5
        print(
            f"{regime:8} {generator:8} {amplitude:4.1f} um {phase:+.2f} rad {frequency:7.1f} Hz",
            end=" ",
        )
        print(f"drawn {drawn:4.1f} W, work {work:4.1f} W")
