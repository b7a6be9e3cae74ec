"""The drill node's account of itself: status and diagnostics."""

from __future__ import annotations

import dataclasses

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rpud_msgs.msg import Status
from std_msgs.msg import Header

from rpud_sim.ros.messages import filled
from rpud_sim.ros.pacing import Timing
from rpud_sim.simulation.commands import Applied
from rpud_sim.simulation.ensemble import Figures
from rpud_sim.simulation.fields import status_fields

LAG_ERROR = 1.0  # simulation time this far behind its schedule is an error [s]


@dataclasses.dataclass(frozen=True)
class Report:
    """What the node did until a block boundary.

    Args:
        state: ``running`` or ``stopped``.
        time: simulation time [ns].
        regime: ``free`` or ``drilling``.
        applied: the commands in force.
        impacts: impacts on the drill tool since the start.
        commands_accepted: since the start.
        commands_rejected: since the start.
        messages_dropped: since the start.
        timing: how well the schedule was kept.
        figures: of the interval since the report before.
    """

    state: str
    time: int
    regime: str
    applied: Applied
    impacts: int
    commands_accepted: int
    commands_rejected: int
    messages_dropped: int
    timing: Timing
    figures: Figures


def report_to_status(report: Report, origin: int) -> Status:
    """Convert to a message; the origin is the stamp of simulation time zero [ns]."""
    values = status_fields(
        origin + report.time,
        report.state,
        report.regime,
        report.applied,
        origin,
        impacts=report.impacts,
        commands_accepted=report.commands_accepted,
        commands_rejected=report.commands_rejected,
        deadlines_missed=report.timing.deadlines_missed,
        messages_dropped=report.messages_dropped,
        real_time_factor=report.timing.real_time_factor,
        lateness_max=report.timing.lateness_max,
        lag=report.timing.lag,
    )
    return filled(Status(), values)


def report_to_diagnostics(
    report: Report, node_name: str, stamp: Time, telemetry_rate: int
) -> DiagnosticArray:
    """Convert to diagnostics of timing and of commands; the stamp is that of the node's clock."""
    timing = report.timing
    if timing.lag > LAG_ERROR:
        level, text = DiagnosticStatus.ERROR, f"simulation time lags {timing.lag:.3f} s behind"
    elif timing.lateness_max * telemetry_rate > 1.0:
        level, text = DiagnosticStatus.WARN, f"a block was {timing.lateness_max:.3f} s late"
    else:
        level, text = DiagnosticStatus.OK, "on time"
    return DiagnosticArray(
        header=Header(stamp=stamp),
        status=[
            _diagnostic(
                f"{node_name}: timing",
                level,
                text,
                {
                    "real_time_factor": f"{timing.real_time_factor:.4f}",
                    "blocks": timing.blocks,
                    "deadlines_missed": timing.deadlines_missed,
                    "lateness [s]": f"{timing.lateness:.6f}",
                    "lateness_max [s]": f"{timing.lateness_max:.6f}",
                    "lag [s]": f"{timing.lag:.6f}",
                    "messages_dropped": report.messages_dropped,
                },
            ),
            _diagnostic(
                f"{node_name}: commands",
                DiagnosticStatus.OK,
                f"{report.commands_rejected} refused",
                {
                    "commands_accepted": report.commands_accepted,
                    "commands_rejected": report.commands_rejected,
                    "weight_on_bit [N]": f"{report.applied.weight_on_bit.force:g}",
                    "drive_enabled": report.applied.drive.enabled,
                    "drive_voltage [V]": f"{report.applied.drive.voltage:g}",
                    "drive_frequency [Hz]": f"{report.applied.drive.frequency:g}",
                },
            ),
        ],
    )


def _diagnostic(name: str, level: bytes, text: str, values: dict[str, object]) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=level,
        name=name,
        message=text,
        hardware_id="rpud_sim",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
