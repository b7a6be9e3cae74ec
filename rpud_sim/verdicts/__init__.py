"""Expectations over time, and verdicts on them from a bag or live."""

from rpud_sim.verdicts.expectation import Expectation
from rpud_sim.verdicts.expectation_files import read_expectations
from rpud_sim.verdicts.record import Record
from rpud_sim.verdicts.units import ExpectationError
from rpud_sim.verdicts.verdict import Verdict, evaluate
from rpud_sim.verdicts.vocabulary import (
    Active,
    Becomes,
    Cleared,
    Formula,
    Message,
    Onset,
    Signal,
)
from rpud_sim.verdicts.words import (
    after,
    always,
    count,
    eventually,
    quantile,
    signal,
    unless,
    until,
)

__all__ = [
    "Active",
    "Becomes",
    "Cleared",
    "Expectation",
    "ExpectationError",
    "Formula",
    "Message",
    "Onset",
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
