"""Sweeps: designs of experiments over the drill's parameters, on processes or on a cluster.

A specification gives a design, and the design a sequence of chunks. The results of each chunk are
written to a file. The finished files are joined to one table of simulations and one of points, from
which the page is made. The files do not depend on which worker runs a chunk, nor when.

A sweep over faults labels each simulation with the truth, and can keep its bag. A sweep with
Saltelli's design gives Sobol indices of its figures.
"""
