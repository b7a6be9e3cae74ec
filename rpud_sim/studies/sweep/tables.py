"""Tables of a sweep: one with a row for each simulation, one with a row for each point."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from rpud_sim.studies.sweep.chunks import Chunk, Outcome
from rpud_sim.studies.sweep.plan import plan_run, point_seed
from rpud_sim.studies.sweep.specification import SweepSpecification

BAGS = "bags"  # folder of the bags
COUNTS = ("events",)  # figures that are whole numbers
_LABELS = {
    "kind": pa.string(),
    "channel": pa.string(),
    "magnitude": pa.float64(),
    "unit": pa.string(),
    "onset": pa.float64(),
    "clear": pa.float64(),
}


def error_name(figure: str) -> str:
    """Return the name of the column with the standard error of a figure's mean."""
    return f"{figure}_standard_error"


def simulation_table(chunk: Chunk, outcome: Outcome) -> pa.Table:
    """Return the rows of a chunk's simulations; missing figures and labels are null."""
    specification = chunk.specification
    seeds, runs = [], []
    for number, point, members in chunk.ensembles():
        seeds += [point_seed(specification, number, point)] * len(members)
        if specification.faults or specification.bags:
            runs += [plan_run(specification, number, point, member) for member in members]
    repeat = specification.repeat
    numbers = chunk.first + np.arange(chunk.count)
    points = numbers // repeat
    columns: dict[str, pa.Array] = {
        "point": pa.array(points),
        "member": pa.array(numbers % repeat),
        "seed": pa.array(seeds, pa.int64()),
        "phase": pa.array(outcome.phases),
        **{
            name: pa.array(values[points - chunk.first_point])
            for name, values in chunk.points.items()
        },
    }
    if specification.faults:
        labels = [run.labels() for run in runs]
        for name, kind in _LABELS.items():
            columns[name] = pa.array([label[name] for label in labels], kind)
    for i, name in enumerate(specification.figures):
        values = outcome.figures[:, i]
        missing = np.isnan(values)
        if name in COUNTS:
            values = np.where(missing, 0.0, values).astype(np.int64)
        columns[name] = pa.array(values, mask=missing)
    columns["failure"] = pa.array(outcome.failures, pa.string())
    if specification.bags:
        pairs = zip(runs, outcome.bags, strict=True)
        paths = [f"{BAGS}/{run.name}" if bag else None for run, bag in pairs]
        columns["bag"] = pa.array(paths, pa.string())
    return pa.table(columns)


class PointTables:
    """Conversion of simulations' rows, added in order and in any portions, to points' rows."""

    def __init__(self, specification: SweepSpecification) -> None:
        self._specification = specification
        self._held: pa.Table | None = None

    def add(self, table: pa.Table) -> pa.Table:
        """Add rows of simulations; return the rows of the points that are complete now."""
        if self._held is not None:
            table = pa.concat_tables([self._held, table])
        repeat = self._specification.repeat
        whole = table.num_rows // repeat * repeat
        # A copy: a slice would keep the rows before it in memory.
        self._held = table.slice(whole).take(pa.array(range(table.num_rows - whole), pa.int64()))
        return self._points(table.slice(0, whole))

    def _points(self, table: pa.Table) -> pa.Table:
        repeat = self._specification.repeat
        firsts = np.arange(0, table.num_rows, repeat)
        columns: dict[str, pa.Array | pa.ChunkedArray] = {
            name: table[name].take(pa.array(firsts))
            for name in ("point", "seed", *self._specification.axes)
        }
        names = self._specification.figures
        figures = np.column_stack(
            [table[name].to_numpy().astype(np.float64) for name in names]
        ).reshape(len(firsts), repeat, len(names))
        valid = ~np.isnan(figures)
        count = valid.sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(valid, figures, 0.0).sum(axis=1) / count
            squares = np.where(valid, (figures - mean[:, None]) ** 2, 0.0).sum(axis=1)
            error = np.sqrt(squares / (count - 1) / count)
        failed = table["failure"].is_valid().to_numpy().reshape(-1, repeat)
        columns["members"] = pa.array(repeat - failed.sum(axis=1))
        for i, name in enumerate(names):
            columns[name] = pa.array(mean[:, i], mask=count[:, i] == 0)
            columns[error_name(name)] = pa.array(error[:, i], mask=count[:, i] < 2)
        return pa.table(columns)
