"""Comparison of runs in bags; ``compare`` is the public face."""

from rpud_sim.recorded.compare.comparison import compare
from rpud_sim.recorded.compare.results import Comparison

__all__ = ["Comparison", "compare"]
