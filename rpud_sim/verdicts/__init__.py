"""Expectations over time, and verdicts on them from a bag or live.

An expectation that cannot be used, by itself or with the topics of a bag, raises an
``ParameterError`` of one line, and a bag that cannot be read a ``BagError``.
"""

from rpud_sim.verdicts.formulas import Active, Becomes, Cleared, Formula, Onset, Published, Signal
from rpud_sim.verdicts.names import Expectation
from rpud_sim.verdicts.notation import (
    after,
    always,
    count,
    eventually,
    quantile,
    read_expectations,
    signal,
    unless,
    until,
)
from rpud_sim.verdicts.record import Record
from rpud_sim.verdicts.verdict import Verdict, evaluate

__all__ = [
    "Active",
    "Becomes",
    "Cleared",
    "Expectation",
    "Formula",
    "Onset",
    "Published",
    "Record",
    "Signal",
    "Verdict",
    "after",
    "always",
    "count",
    "evaluate",
    "eventually",
    "quantile",
    "read_expectations",
    "signal",
    "unless",
    "until",
]
