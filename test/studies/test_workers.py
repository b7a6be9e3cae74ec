"""Workers of a study: kernels are compiled once before local processes start, and only then."""

import pytest

from rpud_sim.studies.sweep.chunks import make_chunks, simulate
from rpud_sim.studies.sweep.design import design_points
from rpud_sim.studies.sweep.specification_file import parse_specification
from rpud_sim.studies.workers import run_on_workers

SPECIFICATION = parse_specification(
    {"design": "grid", "duration": 0.1, "swept": {"weight_on_bit": [5.0, 10.0]}}
)


@pytest.fixture
def chunks():
    return make_chunks(SPECIFICATION, design_points(SPECIFICATION))


def test_kernels_are_compiled_once_before_local_processes_start(chunks):
    calls = []
    outcomes = run_on_workers(simulate, chunks, 1, None, lambda: calls.append("compiled"))
    assert calls == ["compiled"]
    [(chunk, outcome)] = outcomes
    assert (chunk.number, outcome.failures) == (0, (None, None))
    assert calls == ["compiled"]
