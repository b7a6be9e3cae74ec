"""Comparison of runs in bags; ``compare`` is the public face."""

from rpud_sim.recorded.compare.comparison import Comparison, compare

__all__ = ["Comparison", "compare"]
