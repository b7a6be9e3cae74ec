"""Comparison of runs in bags; ``compare`` is the public face."""

from rpud_sim.inspection.compare.comparison import Comparison, compare
from rpud_sim.inspection.compare.recorded_drill import CompareError

__all__ = ["CompareError", "Comparison", "compare"]
