"""The drill in C: `c/drill.c`, built with the machine's compiler, optimized for this processor."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from bench.flight import Flight
from rpud_sim.model.drill import derive
from rpud_sim.simulation import Parameters

SOURCE = Path(__file__).parent / "c" / "drill.c"
FLAGS = ("-O3", "-march=native", "-ffast-math")  # the fastest of those that gcc offers


class DrillInC:
    """The built program, in a folder of its own until the block ends.

    Raises:
        RuntimeError: if there is no C compiler.
    """

    def __enter__(self) -> DrillInC:
        compiler = shutil.which("gcc") or shutil.which("cc")
        if compiler is None:
            raise RuntimeError("the benchmark needs a C compiler: gcc or cc is not to be found")
        self._folder = tempfile.TemporaryDirectory()
        self._program = Path(self._folder.name, "drill")
        subprocess.run(
            [
                *(compiler, "-std=gnu11", *FLAGS),
                *("-o", str(self._program), str(SOURCE), "-lm"),
            ],
            check=True,
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def run(
        self, parameters: Parameters, duration: float, flight: Flight
    ) -> tuple[dict[str, float], np.ndarray]:
        """Run once from a flight on.

        Args:
            parameters: of the drill.
            duration: to simulate [s].
            flight: where it begins.

        Returns:
            Figures by the names of `rpud simulate`, and `cpu_time` [s]; and the times of the first
            impacts on the drill tool [s].
        """
        drill = derive(parameters)
        numbers = (
            drill.in_rock,
            duration,
            flight.phase % 1.0,
            *flight.bodies,
            drill.rpud_mass,
            drill.rpud_damping,
            drill.load_spring_rate,
            drill.free_mass,
            drill.tool_mass,
            drill.tool_damping,
            drill.tool_spring_rate,
            drill.actuator_restitution,
            drill.drill_tool_restitution,
            parameters.weight_on_bit,
            parameters.gravity,
            parameters.vibration_amplitude,
            parameters.vibration_frequency,
        )
        words = [repr(float(number)) for number in numbers]
        output = subprocess.run([self._program, *words], check=True, stdout=subprocess.PIPE).stdout
        figures = json.loads(output)
        return figures, np.array(figures.pop("impact_times"))
