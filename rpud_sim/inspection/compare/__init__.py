"""Comparison of runs in bags; ``compare`` is the public face."""

from rpud_sim.inspection.compare.comparison import compare
from rpud_sim.inspection.compare.results import Comparison

__all__ = ["Comparison", "compare"]
