"""Data sets: labelled runs over faults, rocks, severities and seeds. All of it is synthetic data.

A specification gives a plan of runs. Workers simulate the runs; each gives a bag and a part of each
table. When all runs exist, the parts are joined to one Parquet file for each table and split. The
files do not depend on which worker simulates a run, nor when.
"""

NOTICE = (
    "SYNTHETIC DATA: simulated by rpud_sim, not recorded from a drill. A figure from it says "
    "nothing about a real drill until it is confirmed on one."
)
"""Notice that every output of a data set carries."""
