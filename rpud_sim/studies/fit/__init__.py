"""Fits: the drill's parameters, with intervals, from figures of somebody's drill.

A specification names unknown parameters and target figures. The figures are simulated over a design
of experiments, polynomials stand for them between its points, and the posterior distribution of the
unknowns is sampled with them. The region shrinks around the posterior from round to round.
"""
