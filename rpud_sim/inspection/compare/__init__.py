"""Comparison of runs in bags; ``compare`` is the public face."""

from rpud_sim.inspection.compare.comparison import compare
from rpud_sim.inspection.compare.recorded_drill import CompareError
from rpud_sim.inspection.compare.results import Comparison

__all__ = ["CompareError", "Comparison", "compare"]
