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

# Columns of the fast series, one value for each bin of simulation time.
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

# Columns of the series of statuses, one row for each status.
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


@dataclasses.dataclass(frozen=True)
class Connection:
    """Connection to the drill."""

    state: str  # ``searching`` before the first status, ``connected``, or ``vanished``
    since: float  # when it came to this state, as ``time.time`` counts [s]
    reason: str = ""  # why there is no drill, in one line; empty while connected


@dataclasses.dataclass(frozen=True)
class FaultView:
    """Fault of the drill."""

    number: int  # of the fault
    kind: str  # such as ``free_mass_jammed``
    channel: str  # topic with the faulty signal; empty for the physics
    magnitude: float  # in the unit of the kind
    active: bool  # whether it lasts
    onset: float  # when it began [s of simulation time]
    end: float | None  # when it ended; None while it lasts


@dataclasses.dataclass(frozen=True)
class Mark:
    """Entry of the drill's journal that a plot marks."""

    time: float  # of the entry [s of simulation time]
    kind: str  # such as ``weight_on_bit`` or ``inject``
    text: str  # what took effect, in one line


@dataclasses.dataclass(frozen=True)
class Impact:
    """One impact on the drill tool, with the fields of ``rpud_msgs/ContactForce``."""

    time: float  # at which it begins [s of simulation time]
    sequence: int  # its number since the start
    peak_force: float  # [N]
    contact_duration: float  # [s]
    impact_velocity: float  # [m/s]
    impulse: float  # [N s]
    energy: float  # that arrives [J]
    energy_transferred: float  # that stays [J]
    squeezed: bool  # whether the actuator pressed meanwhile


@dataclasses.dataclass(frozen=True)
class Section:
    """Latest block of the waveform; arrays of equal length, read-only."""

    time: float  # of the first sample [s of simulation time]
    period: float  # between samples [s]
    nodal_plane: np.ndarray  # position [m]
    actuator: np.ndarray  # position of its vibrating tip [m]
    free_mass: np.ndarray  # position [m]
    drill_tool: np.ndarray  # displacement [m]
    contact_force: np.ndarray  # between free mass and drill tool [N]
    reacting_force: np.ndarray  # on the load unit [N]


@dataclasses.dataclass(frozen=True)
class Series:
    """Series over time, the last minute of it.

    Rows are numbered from the start of the run, so a view can tell which it has shown. The rows of
    the last second may still change.
    """

    first: int  # number of the first row
    period: float  # of the rows [s]; 0 where they have a column ``time``
    columns: tuple[str, ...]  # names
    rows: np.ndarray  # one line for each row, NaN where nothing was heard; read-only

    def column(self, name: str) -> np.ndarray:
        return self.rows[:, self.columns.index(name)]


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Action of the operator, and what the drill said to it."""

    number: int  # of the action, from 1 on
    name: str  # such as ``press``
    arguments: Mapping[str, Any]  # as they were given
    state: str  # ``waiting``, ``done``, ``refused`` or ``failed`` (no drill, or no answer)
    text: str  # the drill's own reason, or a result such as ``fault 3``
    since: float  # when it came to this state, as ``time.time`` counts [s]


@dataclasses.dataclass(frozen=True)
class Picture:
    """Everything that is known of a drill at one moment; times count from the run's start [s]."""

    namespace: str  # of the drill
    connection: Connection  # to the drill
    run: int = 0  # number of the run; a restart or a reset begins a new one and empties the series
    version: int = 0  # grows whenever anything was heard
    time: float | None = None  # latest time that was heard [s]
    # fields of the latest ``rpud_msgs/Status`` by name, with times as seconds; without its
    # header. Empty before the first.
    status: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    # latest values of the fast topics: by topic, values by field
    latest: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    impact: Impact | None = None  # the latest, None before the first
    impacts: tuple[Impact, ...] = ()  # the last hundred, oldest first
    faults: tuple[FaultView, ...] = ()  # by number
    kinds: tuple[str, ...] = ()  # of faults that can be injected now
    channels: tuple[str, ...] = ()  # whose signals can be faulty
    marks: tuple[Mark, ...] = ()  # of commands, faults and changes, oldest first
    # fast ones, ``COLUMNS``
    series: Series = dataclasses.field(
        default_factory=lambda: Series(0, 0.05, COLUMNS, np.empty((0, len(COLUMNS))))
    )
    # slow ones, ``STATUS_COLUMNS``
    statuses: Series = dataclasses.field(
        default_factory=lambda: Series(0, 0.0, STATUS_COLUMNS, np.empty((0, len(STATUS_COLUMNS))))
    )
    section: Section | None = None  # latest block of the waveform, None before the first
    # commands that the drill has refused from anybody, and its reason for the latest
    refusals: tuple[int, str] = (0, "")
    # messages by topic that were sent and never arrived
    lost: Mapping[str, int] = dataclasses.field(default_factory=dict)
    outcomes: tuple[Outcome, ...] = ()  # of the operator's latest actions, oldest first
