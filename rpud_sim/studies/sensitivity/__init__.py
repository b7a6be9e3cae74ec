"""Sensitivity: how far the headline figures are known, and which inputs decide that.

A specification gives each input an interval. A Sobol sequence fills these intervals, and the
variance of each figure is divided among the inputs (Sobol indices). The initial phase of the
vibration is one more input: its share is the sampling noise of the chaotic motion.
"""
