"""One run of a campaign: the drill in lockstep with the system under test, and the verdicts."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import shutil
import signal
import time
from multiprocessing import util
from pathlib import Path

from rpud_sim.bag import BagError
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.testing.artefacts import write_bag
from rpud_sim.testing.campaign.outcome import (
    BROKEN,
    COMPLETED,
    Outcome,
    last_lines,
    system_verdict,
)
from rpud_sim.testing.campaign.run_record import RunRecord, run_record
from rpud_sim.testing.campaign.specification import PlannedRun, System
from rpud_sim.testing.drill import Drill
from rpud_sim.testing.errors import DrillError, LostMessagesError, SystemUnderTestError
from rpud_sim.testing.pool import DrillPool
from rpud_sim.verdicts import Expectation, Record, Verdict, evaluate
from rpud_sim.verdicts.verdict import UNDECIDED

BAG = "bag"
OUTPUT = "output.log"
_ATTEMPTS = 3


@dataclasses.dataclass(frozen=True)
class Job:
    """Run for a worker."""

    number: int  # of the run
    run: PlannedRun  # to fly
    of: str  # digest of what is run
    system: System  # under test
    expectations: tuple[Expectation, ...]  # on the run
    folder: Path  # for the bag and the output


def fly_in_worker(job: Job) -> Outcome:
    """Fly a run in a worker process, which keeps its drills for its next runs; see ``fly``."""
    if not _POOLS:
        pool = DrillPool()
        # A worker ignores Ctrl-C. What it starts would inherit that, but not this function.
        signal.signal(signal.SIGINT, lambda number, frame: None)
        # multiprocessing ends its processes without the functions of atexit.
        util.Finalize(None, pool.close, exitpriority=10)
        _POOLS.append(pool)
    return fly(job, _POOLS[0])


_POOLS: list[DrillPool] = []  # of this process: one at most


def fly(job: Job, pool: DrillPool) -> Outcome:
    """Fly a run, write its bag, and return its outcome; every failure is an outcome too.

    A run that the drill or the middleware broke says nothing about the system under test: it is
    flown once more, a few times at most.
    """
    broken: list[str] = []
    while (outcome := _attempt(job, pool)).ending == BROKEN and len(broken) < _ATTEMPTS - 1:
        broken.append(outcome.text)
    return dataclasses.replace(outcome, broken=tuple(broken))


def _attempt(job: Job, pool: DrillPool) -> Outcome:
    begun = time.monotonic()
    shutil.rmtree(job.folder, ignore_errors=True)
    job.folder.mkdir(parents=True)
    reached, digest, bag = 0.0, "", ""
    verdicts: tuple[Verdict, ...] = ()
    drill: Drill | None = None
    try:
        drill = pool.take(job.run.setup, job.system.folder)
        ending, text = _fly(drill, job)
        reached = drill.time
        record = run_record(drill)
        _keep_output(drill, job.folder)
        verdicts, digest = _judge(record, job), record.digest()
        bag = BAG
    except (DrillError, LostMessagesError, BagError, OSError) as error:
        ending, text = BROKEN, str(error)
    finally:
        if drill is not None:
            pool.give_back(drill)
    if ending != COMPLETED:
        verdicts = tuple(_cut_short(verdict, reached) for verdict in verdicts)
    return Outcome(
        job.of,
        ending,
        reached,
        last_lines(text),
        (system_verdict(ending, reached, text), *verdicts),
        digest,
        time.monotonic() - begun,
        bag,
    )


def _fly(drill: Drill, job: Job) -> tuple[str, str]:
    """Step through the run; return how it ended, and why if it ended early."""
    system = job.system
    deadline = time.monotonic() + system.run_timeout
    drill.with_answers(*system.answers, period=system.period, timeout=system.answer_timeout)
    try:
        _start(drill, system)
        for topic in job_topics(job):
            with contextlib.suppress(ParameterError):  # no publisher: it stays undecided
                drill.listen(topic)
        duration = job.run.scenario.duration
        for number in range(1, math.ceil(duration / system.period - 1e-9) + 1):
            if time.monotonic() > deadline:
                return "late", (
                    f"the run has reached {drill.time:.3f} s of simulation time after "
                    f"{system.run_timeout:g} s"
                )
            drill.step(min(number * system.period, duration) - drill.time)
    except SystemUnderTestError as error:
        if not drill.alive:
            raise DrillError(f"the drill has ended; its last lines:\n{drill.output}") from error
        return error.kind, str(error)
    except OSError as error:
        return "died", f"{system.command[0]} cannot be started: {error.strerror}"
    return COMPLETED, ""


def _start(drill: Drill, system: System) -> None:
    drill.start(
        *system.command,
        name=system.name,
        hears=system.hears,
        ready=system.ready or None,
        timeout=system.start_timeout,
    )


def job_topics(job: Job) -> list[str]:
    """Return the topics of others that the expectations need."""
    needed = {topic for expectation in job.expectations for topic in expectation.topics}
    return sorted(topic for topic in needed if topic.startswith("/"))


def _judge(record: RunRecord, job: Job) -> tuple[Verdict, ...]:
    """Write the bag, and return the verdicts on it."""
    bag = job.folder / BAG
    write_bag(bag, record)
    topics = {topic for expectation in job.expectations for topic in expectation.topics}
    filled = Record.from_bag(bag, topics, record.namespace)
    return tuple(evaluate(expectation, filled) for expectation in job.expectations)


def _keep_output(drill: Drill, folder: Path) -> None:
    texts = [f"$ {' '.join(each.command)}\n{each.output}" for each in drill.systems]
    (folder / OUTPUT).write_text("".join(texts))


def _cut_short(verdict: Verdict, reached: float) -> Verdict:
    """Return the verdict on a run that ended early: what has held until then proves nothing."""
    if not verdict.passed:
        return verdict
    text = f"the run ended early, at {reached:.9g} s; until then: {verdict.text}"
    return dataclasses.replace(verdict, outcome=UNDECIDED, margin=None, unit="", text=text)
