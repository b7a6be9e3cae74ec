"""Parameter file of a fit, for ``rpud run --config``; every fitted value is marked."""

from __future__ import annotations

from rpud_sim.foundation.quantities import Flag, Quantity
from rpud_sim.simulation.configuration import PARAMETERS, to_values
from rpud_sim.studies.fit.fit import Fit
from rpud_sim.studies.fit.identifiability import PERCENT
from rpud_sim.studies.fit.specification import Specification, unit_of

_COLUMN = 43  # where comments begin
_IMPACT_DYNAMICS_END = "regime"  # last of the parameters that are always written


def parameter_file(fit: Fit, command: str) -> str:
    """Return a ROS parameter file with the fit's best point.

    Args:
        command: that makes the file again; its comment names it.
    """
    specification = fit.specification
    configuration = specification.configuration(fit.best, _shared(specification))
    values = to_values(configuration)
    lines = [
        "# Best point of a fit. Values marked as fitted are not measured: the fit chose them so",
        "# that the model gives the targets. Made by",
        f"#   {command}",
        *([f"# No intervals: {fit.refusal}."] if fit.refusal else []),
    ]
    for item in fit.comparisons:
        source = f"{item.target.source}: " if item.target.source else ""
        lines.append(f"# {source}{item}")
    lines += ["/**:", "  ros__parameters:"]
    names = list(PARAMETERS)
    always = names[: names.index(_IMPACT_DYNAMICS_END) + 1]
    ordered = ["regime", *(name for name in names if name != "regime")]
    for name in ordered:
        if name not in values:
            continue
        if name not in always and values[name] == PARAMETERS[name].default:
            continue
        value = _written(name, values[name])
        lines.append(f"{f'    {name}: {value}':{_COLUMN}} {_comment(fit, name)}")
    return "\n".join(line.rstrip() for line in lines) + "\n"


def _shared(specification: Specification) -> tuple[tuple[str, object], ...]:
    """Return the own parameters that all targets have."""
    conditions = specification.conditions
    return conditions[0] if len(conditions) == 1 else ()


def _written(name: str, value: object) -> str:
    """Return a value as YAML that ROS reads with the right type."""
    if isinstance(PARAMETERS[name].allowed, Flag):
        return str(value).lower()
    if isinstance(value, float):
        text = f"{value:.6g}" if float(f"{value:.6g}") == value else repr(value)
        mantissa, e, exponent = text.partition("e")
        return (mantissa if "." in mantissa else f"{mantissa}.0") + e + exponent
    return str(value)


def _comment(fit: Fit, name: str) -> str:
    unit = f" [{unit_of(name)}]" if unit_of(name) else ""
    if name in fit.specification.unknowns:
        if fit.found is None:
            return f"# fitted: no interval{unit}"
        interval = fit.found.intervals[name]
        return f"# fitted: {', '.join((f'{PERCENT} interval {interval}{unit}', *interval.remarks))}"
    if name in fit.specification.choices:
        share = sum(p for choices, p in fit.probabilities if choices[name] == fit.best[name])
        allowed = ", ".join(str(value) for value in fit.specification.choices[name])
        return f"# fitted: probability {share:.2g} among {allowed}{unit}"
    if not isinstance(PARAMETERS[name].allowed, Quantity):
        return ""
    return f"#{unit}" if unit else ""
