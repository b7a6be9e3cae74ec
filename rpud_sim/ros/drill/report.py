"""The drill node's account of itself: status and diagnostics."""

from __future__ import annotations

import dataclasses

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rpud_msgs.msg import Status
from std_msgs.msg import Header

from rpud_sim.ros.drill.messages import filled
from rpud_sim.ros.drill.pacing import Timing
from rpud_sim.simulation.commands import Applied
from rpud_sim.simulation.ensemble import Figures
from rpud_sim.simulation.fields import status_fields

LAG_ERROR = 1.0  # simulation time this far behind its schedule is an error [s]

# Fields of the status that a report has by the same name.
_AS_THEY_ARE = (
    "impacts",
    "commands_accepted",
    "commands_rejected",
    "commands_lost",
    "commanders",
    "messages_dropped",
    "vibration_amplitude",
    "resonance_frequency",
    "actuator_temperature",
    "electrical_power",
    "depth",
    "penetration_rate",
    "active_faults",
)


@dataclasses.dataclass(frozen=True)
class Report:
    """What the node did until a block boundary.

    Args:
        state: one of the STATE constants of ``rpud_msgs/Status``.
        time: simulation time [ns].
        regime: ``free`` or ``drilling``.
        applied: the commands in force.
        impacts: impacts on the drill tool since the start.
        commands_accepted: since the start.
        commands_rejected: since the start.
        requests_refused: of services, since the start.
        last_refusal: why the latest command or request was refused.
        commands_lost: whether commands stayed out, and the drill is made safe.
        commanders: publishers on the command topic that has most of them.
        namesakes: other nodes of the same name.
        messages_dropped: since the start.
        vibration_amplitude: of the actuator's tip [m].
        resonance_frequency: of the actuator [Hz].
        actuator_temperature: [K].
        electrical_power: that the actuator draws [W], or NaN.
        depth: of the hole [m], or NaN.
        penetration_rate: over the last second [m/s], or NaN.
        active_faults: that last.
        scheduling: how the system schedules the drilling.
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
    requests_refused: int
    last_refusal: str
    commands_lost: bool
    commanders: int
    namesakes: int
    messages_dropped: int
    vibration_amplitude: float
    resonance_frequency: float
    actuator_temperature: float
    electrical_power: float
    depth: float
    penetration_rate: float
    active_faults: int
    scheduling: str
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
        **{name: getattr(report, name) for name in _AS_THEY_ARE},
        deadlines_missed=report.timing.deadlines_missed,
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
                    "lateness_p50 [s]": f"{timing.lateness_p50:.6f}",
                    "lateness_p99 [s]": f"{timing.lateness_p99:.6f}",
                    "lateness_p99.9 [s]": f"{timing.lateness_p999:.6f}",
                    "lag [s]": f"{timing.lag:.6f}",
                    "scheduling": report.scheduling,
                    "messages_dropped": report.messages_dropped,
                },
            ),
            _diagnostic(
                f"{node_name}: commands",
                *_command_health(report),
                {
                    "commands_accepted": report.commands_accepted,
                    "commands_rejected": report.commands_rejected,
                    "requests_refused": report.requests_refused,
                    "last_refusal": report.last_refusal,
                    "weight_on_bit [N]": f"{report.applied.weight_on_bit.force:g}",
                    "drive_enabled": report.applied.drive.enabled,
                    "drive_voltage [V]": f"{report.applied.drive.voltage:g}",
                    "drive_frequency [Hz]": f"{report.applied.drive.frequency:g}",
                    "commanders": report.commanders,
                },
            ),
            _diagnostic(
                f"{node_name}: drill",
                *_drill_health(report),
                {
                    "state": report.state,
                    "regime": report.regime,
                    "impacts": report.impacts,
                    "vibration_amplitude [m]": f"{report.vibration_amplitude:g}",
                    "resonance_frequency [Hz]": f"{report.resonance_frequency:g}",
                    "actuator_temperature [K]": f"{report.actuator_temperature:g}",
                    "electrical_power [W]": f"{report.electrical_power:g}",
                    "depth [m]": f"{report.depth:g}",
                    "penetration_rate [m/s]": f"{report.penetration_rate:g}",
                    "active_faults": report.active_faults,
                    "namesakes": report.namesakes,
                },
            ),
        ],
    )


def _command_health(report: Report) -> tuple[bytes, str]:
    if report.commands_lost:
        return DiagnosticStatus.ERROR, "commands are lost: the drill is made safe"
    if report.commanders > 1:
        return DiagnosticStatus.WARN, f"{report.commanders} publishers command at once"
    return DiagnosticStatus.OK, f"{report.commands_rejected} refused"


def _drill_health(report: Report) -> tuple[bytes, str]:
    if report.namesakes:
        return DiagnosticStatus.WARN, f"{report.namesakes + 1} nodes have this name"
    if report.active_faults:
        return DiagnosticStatus.WARN, f"{report.active_faults} faults injected"
    return DiagnosticStatus.OK, report.state


def _diagnostic(name: str, level: bytes, text: str, values: dict[str, object]) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=level,
        name=name,
        message=text,
        hardware_id="rpud_sim",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
