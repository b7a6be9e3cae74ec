"""Quantities that runs are compared by: where a bag holds them, and which figures are tested."""

from __future__ import annotations

from dataclasses import dataclass

from rpud_sim.pages.quantities import QUANTITIES as SHOWN
from rpud_sim.pages.quantities import Quantity as ShownQuantity

MEAN, MEDIAN, P95 = "mean", "median", "p95"  # figures of a distribution

_ALL = (MEAN, MEDIAN, P95)


@dataclass(frozen=True)
class Quantity:
    """Quantity of a run."""

    name: str  # of the quantity, and of its key in JSON
    unit: str  # SI unit
    topic: str  # relative name of its topic
    column: str = ""  # of the topic's table; empty if it is computed from impacts
    tested: tuple[str, ...] = _ALL  # figures that are compared; others would only repeat them
    fewest: int = 40  # number of values below which nothing is decided
    resolution: float = 0.0  # size of the rounding of its values; smaller differences mean nothing

    @property
    def averaged(self) -> bool:
        """Whether its values are means over parts of the time, so that only their mean counts."""
        return self.tested == (MEAN,)

    @property
    def shown(self) -> ShownQuantity:
        """How people read it."""
        return SHOWN[_SHOWN_AS.get(self.name, self.name)]


# Names in the table of quantities, where they differ from those in JSON.
_SHOWN_AS = {"energy": "impact_energy", "nodal_plane_position": "nodal_plane"}

IMPACTS = "contact_force"  # topic of the impacts
STATUS = "status"  # topic of the powers and the timing

QUANTITIES = (
    # The mean of the intervals is one over the rate, so it is not tested again.
    Quantity("impact_rate", "1/s", IMPACTS, tested=(MEAN,)),
    Quantity("impact_interval", "s", IMPACTS, tested=(MEDIAN, P95)),
    Quantity("peak_force", "N", IMPACTS, "peak_force"),
    Quantity("impact_velocity", "m/s", IMPACTS, "impact_velocity"),
    Quantity("energy", "J", IMPACTS, "energy"),
    Quantity("contact_duration", "s", IMPACTS, "contact_duration"),
    Quantity("impact_power", "W", IMPACTS, tested=(MEAN,)),
    Quantity("reacting_force", "N", "reacting_force", "force"),
    Quantity("nodal_plane_position", "m", "nodal_plane", "position"),
    *(
        Quantity(name, unit, STATUS, name, (MEAN,), fewest=16, resolution=resolution)
        for name, unit, resolution in (
            ("penetration_rate", "m/s", 1e-12),
            ("electrical_power", "W", 1e-9),
            ("actuator_power", "W", 1e-9),
            ("weight_power", "W", 1e-9),
            ("load_damper_power", "W", 1e-9),
            ("collision_power", "W", 1e-9),
            ("absorbed_power", "W", 1e-9),
        )
    ),
)

# Relative names of the topics that are read.
TOPICS = (IMPACTS, "reacting_force", "nodal_plane", STATUS)

# Types of these topics; another type of the same name is left out.
TYPES = {
    IMPACTS: "rpud_msgs/msg/ContactForce",
    "reacting_force": "rpud_msgs/msg/ReactingForce",
    "nodal_plane": "rpud_msgs/msg/NodalPlane",
    STATUS: "rpud_msgs/msg/Status",
}

# Fields of a status about timing, which belong to the machine and are never tested.
TIMING = (
    ("lateness_max", "latest block", "s"),
    ("lag", "lag behind the schedule", "s"),
    ("real_time_factor", "real-time factor", ""),
)

# Fields of a status that count since the start.
COUNTERS = (
    ("deadlines_missed", "deadlines missed"),
    ("messages_dropped", "messages dropped"),
    ("commands_rejected", "commands refused"),
)
