"""Local processes: chunks of a lost one run again, and a failure is one line."""

import dataclasses
import multiprocessing
import os

import pytest
from plain_values import parse_specification

from rpud_sim.studies.sweep.sweep import SweepChunk, design_points, make_chunks, simulate
from rpud_sim.studies.workers import WorkerError, run_chunks

SPECIFICATION = parse_specification(
    {"design": "grid", "duration": 5.0, "swept": {"weight_on_bit": [5.0, 10.0, 15.0, 20.0, 25.0]}}
)


@pytest.fixture
def chunks():
    made = list(make_chunks(SPECIFICATION, design_points(SPECIFICATION)))
    assert len(made) == 3
    yield made
    assert multiprocessing.active_children() == []


class Deadly(SweepChunk):
    """A chunk that ends the process that receives it."""

    def __reduce__(self):
        return os._exit, (3,)


def deadly(chunk):
    return Deadly(**{field.name: getattr(chunk, field.name) for field in dataclasses.fields(chunk)})


def test_outcomes_are_those_of_this_process(chunks):
    outcomes = run_chunks(simulate, chunks, 5)  # more workers than chunks
    found = {chunk.number: outcome for chunk, outcome in outcomes}
    assert sorted(found) == [0, 1, 2]
    for chunk in chunks:
        assert found[chunk.number].table.equals(simulate(chunk).table)


def test_a_chunk_that_ends_every_worker_is_named_and_takes_no_other_with_it(chunks):
    outcomes = run_chunks(simulate, [chunks[0], deadly(chunks[1]), chunks[2]], 1)
    assert next(outcomes)[0].number == 0
    with pytest.raises(WorkerError, match=r"^chunk 1 ended its worker 3 times$"):
        next(outcomes)


def test_the_chunks_of_a_killed_worker_run_again(chunks):
    outcomes = run_chunks(simulate, chunks, 2)
    found = [next(outcomes)[0].number]
    multiprocessing.active_children()[0].kill()
    found += [chunk.number for chunk, _ in outcomes]
    assert sorted(found) == [0, 1, 2]


def test_an_error_of_a_worker_is_raised_here(chunks):
    wrong = dataclasses.replace(chunks[0], versions={"numpy": "1.2.3"})
    with pytest.raises(WorkerError, match=r"a worker has numpy .* this machine 1\.2\.3"):
        list(run_chunks(simulate, [wrong], 1))


def test_closing_the_iterator_ends_the_workers(chunks):
    outcomes = run_chunks(simulate, chunks, 2)
    next(outcomes)
    outcomes.close()
