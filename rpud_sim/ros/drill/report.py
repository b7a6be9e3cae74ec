"""Report on the state of the drill node, and its diagnostics."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from rpud_sim.drilling.mount import FEED_MODES, RATE
from rpud_sim.drilling.process import ProcessState
from rpud_sim.drilling.rock import NO_DEEPER
from rpud_sim.ros.delay_histogram import DelayHistogram
from rpud_sim.ros.drill.pacer import Punctuality
from rpud_sim.simulation.ensemble import Figures
from rpud_sim.simulation.fields import Fields
from rpud_sim.simulation.ledger import FaultRecord

# Power that the steps of the arm may lose or win, as a share of the work of actuator and feed.
COUPLING_SHARE = 0.05
LEAST_POWER = 0.1  # of both, so that a drill at rest is none [W]
# Amplitude below which a driven vibration is stalled, as a share of that without load.
STALLED_SHARE = 0.05
LAG_ERROR = 1.0  # simulation time this far behind its schedule is an error [s]


@dataclasses.dataclass(frozen=True)
class Report:
    """State of the node at a block boundary."""

    time: int  # simulation time [ns]
    status: Fields  # the fields of its ``rpud_msgs/Status``
    coupling_power: float  # that the steps of the arm lose [W]; NaN without a feed
    # of the driven vibration without load, on resonance [m]; 0 where no load acts on it
    unloaded_amplitude: float
    process: ProcessState  # state of rotation, feed and borehole
    at_tool_length: bool  # whether the hole is as deep as the drill tool is long
    faults: tuple[FaultRecord, ...]  # that last
    requests_refused: int  # of services, since the start
    last_refusal: str  # why the latest command or request was refused
    namesakes: int  # other nodes of the same name
    scheduling: str  # how the system schedules the pacing thread
    timing: Punctuality  # punctuality of the blocks
    command_delays: (
        DelayHistogram  # of commands, from their arrival until they acted, in the last second
    )
    # of impacts, from their stamps until they were published, in the last second
    impact_delays: DelayHistogram
    figures: Figures  # of the interval since the report before
    published: Mapping[str, int]  # messages by topic, the status of this report among them
    subscribers: Mapping[str, int]  # by topic
    publishers: Mapping[str, int]  # whose commands reach the node, by topic
    acknowledged: bool  # whether all reliable subscribers have every message


def report_to_diagnostics(
    report: Report, node_name: str, stamp: Time, telemetry_rate: int
) -> DiagnosticArray:
    """Convert to diagnostics of timing and of commands; the stamp is that of the node's clock."""
    timing, status = report.timing, report.status
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
                    **_delay_values("impact", report.impact_delays),
                    "scheduling": report.scheduling,
                    "messages_dropped": status["messages_dropped"],
                },
            ),
            _diagnostic(
                f"{node_name}: commands",
                *_command_health(status),
                {
                    "commands_accepted": status["commands_accepted"],
                    "commands_rejected": status["commands_rejected"],
                    "commands_discarded": status["commands_discarded"],
                    **_delay_values("command", report.command_delays),
                    "requests_refused": report.requests_refused,
                    "last_refusal": report.last_refusal,
                    "weight_on_bit [N]": f"{status['weight_on_bit']:g}",
                    "drive_enabled": status["drive_enabled"],
                    "drive_voltage [V]": f"{status['drive_voltage']:g}",
                    "drive_frequency [Hz]": f"{status['drive_frequency']:g}",
                    **_feed_values(report),
                    "commanders": status["commanders"],
                },
            ),
            _diagnostic(
                f"{node_name}: drill",
                *_drill_health(report),
                {
                    "state": status["state"],
                    "regime": status["regime"],
                    "impacts": status["impacts"],
                    "vibration_amplitude [m]": f"{status['vibration_amplitude']:g}",
                    "resonance_frequency [Hz]": f"{status['resonance_frequency']:g}",
                    "actuator_temperature [K]": f"{status['actuator_temperature']:g}",
                    "electrical_power [W]": f"{status['electrical_power']:g}",
                    "depth [m]": f"{status['depth']:g}",
                    "penetration_rate [m/s]": f"{status['penetration_rate']:g}",
                    **_borehole_values(report),
                    **_coupling_values(report),
                    "active_faults": status["active_faults"],
                    "namesakes": report.namesakes,
                },
            ),
            _diagnostic(
                f"{node_name}: messages",
                *_message_health(status),
                {
                    "published": _numbers(report.published),
                    "subscribers": _numbers(report.subscribers),
                    "publishers": _numbers(report.publishers),
                    "acknowledged": report.acknowledged,
                },
            ),
        ],
    )


def _delay_values(name: str, delays: DelayHistogram) -> dict[str, object]:
    return {
        f"{name}_delay_p50 [s]": f"{delays.quantile(0.5):.6f}",
        f"{name}_delay_p99 [s]": f"{delays.quantile(0.99):.6f}",
        f"{name}_delay_max [s]": f"{delays.greatest:.6f}",
    }


def _feed_values(report: Report) -> dict[str, object]:
    """Return the feed in force, in the unit of its mode; nothing without a feed."""
    if report.process.mount is None:
        return {}
    mode = FEED_MODES[report.status["feed_mode"]]
    unit = "m/s" if mode == RATE else "m"
    return {"feed_mode": mode, f"feed_value [{unit}]": f"{report.status['feed_value']:g}"}


def _borehole_values(report: Report) -> dict[str, object]:
    """Return how far the bit has walked; nothing without a borehole."""
    if (borehole := report.process.borehole) is None:
        return {}
    return {"side_offset [m]": f"{borehole.side_offset:g}"}


def _coupling_values(report: Report) -> dict[str, object]:
    """Return what the steps of the arm lose; nothing without a feed."""
    if report.process.mount is None:
        return {}
    return {"coupling_power [W]": f"{report.coupling_power:.3g}"}


def _command_health(status: Fields) -> tuple[bytes, str]:
    if status["commands_lost"]:
        return DiagnosticStatus.ERROR, "commands are lost: the drill is made safe"
    if status["commands_discarded"]:
        return DiagnosticStatus.WARN, f"{status['commands_discarded']} discarded"
    if status["commanders"] > 1:
        return DiagnosticStatus.WARN, f"{status['commanders']} publishers command at once"
    return DiagnosticStatus.OK, f"{status['commands_rejected']} refused"


def _drill_health(report: Report) -> tuple[bytes, str]:
    if report.namesakes:
        return DiagnosticStatus.WARN, f"{report.namesakes + 1} nodes have this name"
    amplitude, unloaded = report.status["vibration_amplitude"], report.unloaded_amplitude
    if amplitude < STALLED_SHARE * unloaded:
        return DiagnosticStatus.WARN, (
            f"stalled: the vibration has {amplitude * 1e6:.2g} um, less than {STALLED_SHARE:.0%} "
            f"of {unloaded * 1e6:.3g} um without load"
        )
    powers = (report.status["actuator_power"], report.status["feed_power"], LEAST_POWER)
    flow = max(map(abs, powers))
    if abs(report.coupling_power) > COUPLING_SHARE * flow:
        return DiagnosticStatus.WARN, (
            f"steps of the arm lose {report.coupling_power:.3g} W, more than {COUPLING_SHARE:.0%} "
            f"of {flow:.3g} W: the arm is too soft or too lightly damped for them"
        )
    if faults := report.status["active_faults"]:
        return DiagnosticStatus.WARN, f"{faults} faults injected"
    if report.at_tool_length:
        return DiagnosticStatus.WARN, NO_DEEPER
    return DiagnosticStatus.OK, report.status["state"]


def _message_health(status: Fields) -> tuple[bytes, str]:
    if status["messages_dropped"]:
        return DiagnosticStatus.WARN, f"{status['messages_dropped']} dropped"
    return DiagnosticStatus.OK, "none dropped"


def _numbers(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())


def _diagnostic(name: str, level: bytes, text: str, values: dict[str, object]) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=level,
        name=name,
        message=text,
        hardware_id="rpud_sim",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
