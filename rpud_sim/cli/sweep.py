"""Runs at many points of the parameters: ``rpud sweep``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import ASSIGNMENT, JSON, command
from rpud_sim.cli.program import ExitCode, print_result
from rpud_sim.foundation.atomic_folder import atomic_file
from rpud_sim.foundation.extras import import_extra
from rpud_sim.foundation.options import POSITIVE_SECONDS, option
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.foundation.terminal import error_text, printable, table
from rpud_sim.foundation.user_files import named_errors, open_file

if TYPE_CHECKING:
    import pandas

_SEEDS = Quantity("", "runs at each point", 1, 1e6, whole=True)
_SHOWN = (  # columns in the table; the file has all
    "drill_tool_impact_rate",
    "contact_force_mean",
    "energy_absorbed_rate",
    "reacting_force_mean",
)


@command(
    "sweep",
    "--set weight_on_bit=5,10,20,40 --seeds 8 --duration 2 --out sweep.csv",
    "simulate many points of the parameters, on all cores",
    "The points are all combinations of the values of --set, with each row of --points.",
    JSON,
    assignments=option(
        (), "values of one parameter; can be repeated", **{**ASSIGNMENT, "metavar": "NAME=V1,V2"}
    ),
    points=option(None, "CSV file of points; its columns are parameters", metavar="FILE"),
    duration=option(10.0, "simulated time of each run", POSITIVE_SECONDS),
    seeds=option(1, "runs at each point, with seeds from 0 on", _SEEDS),
    out=option(None, "write a row for each run", metavar="FILE.csv|.parquet"),
    plots=option(None, "write a picture of each metric into a folder", metavar="DIR"),
)
def _sweep(options: Any) -> int:
    from rpud_sim.scripting.sweep import grid, sweep

    values = dict(map(_values, options.assignments))
    rows = [{**row, **each} for row in _read(options.points) for each in grid(values)]
    if rows == [{}]:
        raise ParameterError("there are no points: give --set or --points")
    out = Path(options.out) if options.out else None
    if out and out.suffix not in (".csv", ".parquet"):
        raise ParameterError(f"--out {options.out} ends neither in .csv nor in .parquet")
    if options.plots:  # before the work, as the file
        pictures = import_extra("matplotlib.figure", "a picture", "'rpud_sim[studies]'")
        plots = Path(options.plots)
        if plots.exists() and not plots.is_dir():
            raise ParameterError(f"--plots {options.plots} is not a folder")
    with atomic_file(out) if out else nullcontext() as unfinished:
        frame = sweep(rows, options.duration, int(options.seeds))
        if out and unfinished:
            with named_errors(out):
                _write(frame, unfinished, out.suffix)
    files = [options.out] if out else []
    if options.plots:
        files += [str(path) for path in _plots(pictures, frame, plots)]
    failures = frame["failure"].dropna()
    # A frame has NaN where there is no number, which JSON has not.
    records = frame.astype(object).where(frame.notna(), None).to_dict("records")
    content = {"rows": records, "units": frame.attrs["units"], "files": files}
    print_result(options, content, lambda: _lines(frame, files))
    return ExitCode.INCOMPLETE if len(failures) else ExitCode.DONE


def _values(text: str) -> tuple[str, Any]:
    """Return a parameter and its values, which are separated by commas or a list in YAML."""
    from rpud_sim.simulation.configuration import parse_assignment

    name, value = parse_assignment(text)
    if isinstance(value, str) and "," in value:
        return name, [parse_assignment(f"{name}={part}")[1] for part in value.split(",")]
    return name, value


def _read(path: str | None) -> list[dict[str, Any]]:
    """Return the rows of a CSV file; an empty cell is left out."""
    from rpud_sim.foundation.extras import import_extra

    pandas = import_extra("pandas", "a sweep", "pandas")
    if path is None:
        return [{}]
    with named_errors(path, ParameterError), open_file(path) as file:
        try:
            frame = pandas.read_csv(file)
        except ValueError as error:
            raise ParameterError(f"{path}: {error_text(error)}") from None
    return [
        {str(name): value for name, value in row.items() if not pandas.isna(value)}
        for row in frame.to_dict("records")
    ]


def _write(frame: pandas.DataFrame, path: Path, suffix: str) -> None:
    if suffix == ".csv":
        frame.to_csv(path, index=False)
    else:
        frame.to_parquet(path)


def _points(frame: pandas.DataFrame) -> list[str]:
    """Return the parameters that a sweep has more than one value of."""
    names = list(frame)[: list(frame).index("seed")]
    return [name for name in names if frame[name].astype(str).nunique() > 1]


def _lines(frame: pandas.DataFrame, files: list[str]) -> Iterator[str]:
    """Yield means at each point with their standard errors."""
    names, units = _points(frame), frame.attrs["units"]
    shown = [name for name in _SHOWN if name in frame]
    rows = []
    texts = frame[names].astype(str)
    groups = frame.groupby([texts[name] for name in names], sort=False) if names else [((), frame)]
    for point, group in groups:
        means, errors = group[shown].mean(), group[shown].sem()
        cells = (
            f"{means[name]:.4g}" + (f" +- {errors[name]:.2g}" if errors[name] > 0.0 else "")
            for name in shown
        )
        rows.append((*point, *cells))
    head = [f"{name} [{units[name]}]" if units[name] else name for name in (*names, *shown)]
    yield from table(head, rows, len(names))
    failures = frame["failure"].dropna()
    yield f"{len(frame)} runs, {len(failures)} failed"
    yield from (f"run {number}: {printable(reason)}" for number, reason in failures.items())
    yield from map(printable, files)


def _plots(pictures: Any, frame: pandas.DataFrame, folder: Path) -> Iterator[Path]:
    """Write one picture for each metric, over each parameter; yield the files."""
    folder.mkdir(parents=True, exist_ok=True)
    names, units = _points(frame), frame.attrs["units"]
    metrics = list(frame)[list(frame).index("seed") + 1 : -1]
    for metric in metrics if names else ():
        picture = pictures.Figure(figsize=(4 * len(names), 3), layout="constrained")
        for axes, name in zip(
            picture.subplots(1, len(names), squeeze=False)[0], names, strict=True
        ):
            values = frame[name]
            number = values.notna().all() and values.dtype.kind in "iuf"
            own = frame[metric].groupby(values if number else values.astype(str), sort=False)
            axes.errorbar(own.mean().index, own.mean(), own.sem().fillna(0.0), fmt="o-", capsize=3)
            axes.set_xlabel(f"{name} [{units[name]}]" if units[name] else name)
        picture.axes[0].set_ylabel(f"{metric} [{units[metric]}]" if units[metric] else metric)
        path = folder / f"{metric}.png"
        picture.savefig(path)
        yield path
