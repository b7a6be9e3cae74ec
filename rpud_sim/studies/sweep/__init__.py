"""Designs of experiments over the drill's parameters, on processes or on a cluster.

A specification becomes a design, the design a row of chunks, and each chunk's results a file; the
finished files become one table of simulations and one of points, and these the pictures. Which
worker runs a chunk, and when, changes nothing in any file.
"""
