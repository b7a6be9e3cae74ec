"""Picture of a drill: everything that a view shows, frozen at one moment."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

SEARCHING = "searching"
CONNECTED = "connected"
VANISHED = "vanished"

WAITING = "waiting"
DONE = "done"
REFUSED = "refused"
FAILED = "failed"

COLUMNS = (
    "nodal_plane_min",  # position [m]
    "nodal_plane_max",
    "free_mass_min",  # position [m]
    "free_mass_max",
    "drill_tool_min",  # displacement [m]
    "drill_tool_max",
    "reacting_force_min",  # [N]
    "reacting_force_max",
    "impacts",  # number
    "peak_force_min",  # of the impacts [N]
    "peak_force_max",
    "energy",  # of the arriving free mass, of all impacts [J]
    "energy_transferred",  # of that, what stays in drill tool and rock [J]
    "electrical_power",  # latest [W]
    "rotation_rate_min",  # [rad/s]; this and what follows: NaN where the model is off
    "rotation_rate_max",
    "torque_min",  # of rock and cuttings [N m]
    "torque_max",
    "drive_torque_min",  # [N m]
    "drive_torque_max",
    "mount_position_min",  # [m]
    "mount_position_max",
    "feed_min",  # position of its drive [m]
    "feed_max",
    "mount_force_min",  # of the arm on the mount [N]
    "mount_force_max",
    "depth_min",  # [m]
    "depth_max",
)
"""Columns of the fast series, one value for each bin of simulation time."""

STATUS_COLUMNS = (
    "time",  # [s]
    "weight_on_bit",  # [N]
    "drive_voltage",  # zero while it is off [V]
    "electrical_power",  # [W]
    "actuator_power",  # this and the others: means over the last second [W]
    "weight_power",
    "change_power",
    "load_damper_power",
    "collision_power",
    "absorbed_power",
    "stored_power",
    "depth",  # [m]
    "penetration_rate",  # [m/s]
    "vibration_amplitude",  # [m]
    "lateness_max",  # [s]
    "lag",  # [s]
    "real_time_factor",
)
"""Columns of the series of statuses, one row for each status."""


@dataclasses.dataclass(frozen=True)
class Connection:
    """Connection to the drill.

    Args:
        state: ``searching`` before the first status, ``connected``, or ``vanished``.
        since: when it came to this state, as ``time.time`` counts [s].
        reason: why there is no drill, in one line; empty while connected.
    """

    state: str
    since: float
    reason: str = ""


@dataclasses.dataclass(frozen=True)
class FaultView:
    """Fault of the drill.

    Args:
        number: of the fault.
        kind: such as ``free_mass_jammed``.
        channel: topic with the faulty signal; empty for the physics.
        magnitude: in the unit of the kind.
        active: whether it lasts.
        onset: when it began [s of simulation time].
        end: when it ended; None while it lasts.
    """

    number: int
    kind: str
    channel: str
    magnitude: float
    active: bool
    onset: float
    end: float | None


@dataclasses.dataclass(frozen=True)
class Mark:
    """Entry of the drill's journal that a plot marks.

    Args:
        time: of the entry [s of simulation time].
        kind: such as ``weight_on_bit`` or ``inject``.
        text: what took effect, in one line.
    """

    time: float
    kind: str
    text: str


@dataclasses.dataclass(frozen=True)
class Impact:
    """One impact on the drill tool, with the fields of ``rpud_msgs/ContactForce``.

    Args:
        time: at which it begins [s of simulation time].
        sequence: its number since the start.
        peak_force: [N].
        contact_duration: [s].
        impact_velocity: [m/s].
        impulse: [N s].
        energy: that arrives [J].
        energy_transferred: that stays [J].
        squeezed: whether the actuator pressed meanwhile.
    """

    time: float
    sequence: int
    peak_force: float
    contact_duration: float
    impact_velocity: float
    impulse: float
    energy: float
    energy_transferred: float
    squeezed: bool


@dataclasses.dataclass(frozen=True)
class Section:
    """Latest block of the waveform; arrays of equal length, read-only.

    Args:
        time: of the first sample [s of simulation time].
        period: between samples [s].
        nodal_plane: position [m].
        actuator: position of its vibrating tip [m].
        free_mass: position [m].
        drill_tool: displacement [m].
        contact_force: between free mass and drill tool [N].
        reacting_force: on the load unit [N].
    """

    time: float
    period: float
    nodal_plane: np.ndarray
    actuator: np.ndarray
    free_mass: np.ndarray
    drill_tool: np.ndarray
    contact_force: np.ndarray
    reacting_force: np.ndarray


@dataclasses.dataclass(frozen=True)
class Series:
    """Series over time, the last minute of it.

    Rows are numbered from the start of the run, so a view can tell which it has shown. The rows of
    the last second may still change.

    Args:
        first: number of the first row.
        period: of the rows [s]; 0 where they have a column ``time``.
        columns: names.
        rows: one line for each row, NaN where nothing was heard; read-only.
    """

    first: int
    period: float
    columns: tuple[str, ...]
    rows: np.ndarray

    def column(self, name: str) -> np.ndarray:
        """Return the values of a column."""
        return self.rows[:, self.columns.index(name)]

    @property
    def times(self) -> np.ndarray:
        """Time of each row, the beginning of its bin [s of simulation time]."""
        if not self.period:
            return self.column("time")
        return (self.first + np.arange(len(self.rows))) * self.period


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Action of the operator, and what the drill said to it.

    Args:
        number: of the action, from 1 on.
        name: such as ``press``.
        arguments: as they were given.
        state: ``waiting``, ``done``, ``refused`` or ``failed`` (no drill, or no answer).
        text: the drill's own reason, or a result such as ``fault 3``.
        since: when it came to this state, as ``time.time`` counts [s].
    """

    number: int
    name: str
    arguments: Mapping[str, Any]
    state: str
    text: str
    since: float


@dataclasses.dataclass(frozen=True)
class Picture:
    """Everything that is known of a drill at one moment.

    Times are simulation time since the start of the run [s], unless they say otherwise.

    Args:
        namespace: of the drill.
        connection: to the drill.
        run: number of the run; a restart or a reset begins a new one and empties the series.
        version: grows whenever anything was heard.
        origin: stamp of simulation time zero [ns].
        time: latest time that was heard [s].
        status: fields of the latest ``rpud_msgs/Status`` by name, with times as seconds; without
            its header. Empty before the first.
        latest: latest values of the fast topics: by topic, values by field.
        impact: the latest, None before the first.
        impacts: the last hundred, oldest first.
        faults: by number.
        kinds: of faults that can be injected now.
        channels: whose signals can be faulty.
        marks: of commands, faults and changes, oldest first.
        series: fast ones, ``COLUMNS``.
        statuses: slow ones, ``STATUS_COLUMNS``.
        section: latest block of the waveform, None before the first.
        refusals: commands that the drill has refused from anybody, and its reason for the latest.
        lost: messages by topic that were sent and never arrived.
        outcomes: of the operator's latest actions, oldest first.
    """

    namespace: str
    connection: Connection
    run: int = 0
    version: int = 0
    origin: int | None = None
    time: float | None = None
    status: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    latest: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    impact: Impact | None = None
    impacts: tuple[Impact, ...] = ()
    faults: tuple[FaultView, ...] = ()
    kinds: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    marks: tuple[Mark, ...] = ()
    series: Series = dataclasses.field(
        default_factory=lambda: Series(0, 0.05, COLUMNS, np.empty((0, len(COLUMNS))))
    )
    statuses: Series = dataclasses.field(
        default_factory=lambda: Series(0, 0.0, STATUS_COLUMNS, np.empty((0, len(STATUS_COLUMNS))))
    )
    section: Section | None = None
    refusals: tuple[int, str] = (0, "")
    lost: Mapping[str, int] = dataclasses.field(default_factory=dict)
    outcomes: tuple[Outcome, ...] = ()
