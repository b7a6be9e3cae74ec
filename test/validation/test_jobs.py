"""Jobs keep their order and their errors."""

import os
import threading

import pytest

from validation.jobs import gather, silent


def test_work_keeps_its_order_and_its_errors():
    assert gather(lambda number: number**2, range(50), "", silent) == [n**2 for n in range(50)]
    with pytest.raises(ZeroDivisionError):
        gather(lambda number: 1 / number, [1, 0], "", silent)


def test_every_core_has_a_worker(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: range(5))
    together = threading.Barrier(5, timeout=60.0)
    assert sorted(gather(lambda number: together.wait(), range(5), "", silent)) == [*range(5)]
