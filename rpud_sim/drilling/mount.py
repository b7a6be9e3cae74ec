"""Mount: the feed moves the drill along its axis, and the weight on bit follows."""

from __future__ import annotations

import dataclasses

from rpud_sim.drilling.feed import POSITION, RATE, STANDSTILL, Motion
from rpud_sim.drilling.inputs import Disturbances
from rpud_sim.foundation.parameters import ParameterGroup, choice, number
from rpud_sim.foundation.quantities import ParameterError


@dataclasses.dataclass(frozen=True)
class MountParameters(ParameterGroup):
    """Parameters of feed and arm, in SI units.

    The paper gives none of them: all are assumed.

    Raises:
        ParameterError: if a value is outside its range, or if two do not fit together.
    """

    feed_model: str = choice(
        "none",
        ("none", "arm"),
        "none: the weight on bit is commanded; arm: a feed on an arm is commanded, and the weight "
        "on bit follows",
    )
    initial_feed: float = number(
        0.0,
        "m",
        "position of the feed at time zero; at zero the tool just touches the rock",
        -1.0,
        1.0,
    )
    feed_minimum: float = number(-0.1, "m", "least position of the feed", -1.0, 1.0)
    feed_maximum: float = number(0.3, "m", "greatest position of the feed", -1.0, 1.0)
    feed_rate_limit: float = number(
        5e-3, "m/s", "greatest rate of the feed, in both directions", 1e-9, 1.0
    )
    arm_stiffness: float = number(
        2e4, "N/m", "stiffness of the arm along the drill axis; 0 for a rigid arm", 0.0, 1e9
    )
    arm_damping: float = number(
        200.0, "N s/m", "viscous friction of the mount in its guide", 0.0, 1e6
    )
    arm_play: float = number(0.0, "m", "whole play between feed and mount", 0.0, 1e-2)
    anchoring_force: float = number(
        100.0, "N", "force of the arm above which its host slips", 1e-3, 1e3
    )
    contact_release: float = number(
        1e-4,
        "m",
        "distance behind the bottom of the hole at which the drill tool leaves the rock",
        0.0,
        1e-2,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.feed_minimum <= self.initial_feed <= self.feed_maximum:
            raise ParameterError(
                f"initial_feed = {self.initial_feed:g} m is not between "
                f"feed_minimum = {self.feed_minimum:g} m and "
                f"feed_maximum = {self.feed_maximum:g} m"
            )

    def check(self, motion: Motion) -> None:
        """Check that the feed can make a motion.

        Raises:
            ParameterError: if its rate or position is outside the feed's limits.
        """
        limit = self.feed_rate_limit
        if motion.mode == RATE and not -limit <= motion.value <= limit:
            raise ParameterError(
                f"feed rate = {motion.value:g} m/s is outside its range [{-limit:g}, {limit:g}]"
            )
        least, greatest = self.feed_minimum, self.feed_maximum
        if motion.mode == POSITION and not least <= motion.value <= greatest:
            raise ParameterError(
                f"feed position = {motion.value:g} m is outside its range [{least:g}, {greatest:g}]"
            )


@dataclasses.dataclass(frozen=True)
class MountState:
    """State of feed and mount at one time, immutable.

    Positions are along the drill axis, positive toward the rock; at zero the tool of an unloaded
    arm just touches the rock at the start of a hole.

    Args:
        position: of the mount [m].
        feed: position of the feed's drive [m].
        rate: of the feed's drive [m/s].
        force: of the arm on the mount, toward the rock [N].
        weight_on_bit: force of the compressed load spring [N].
        in_contact: whether the drill tool is in the rock.
        slip: way of the host since time zero, toward the rock [m].
    """

    position: float
    feed: float
    rate: float
    force: float
    weight_on_bit: float
    in_contact: bool
    slip: float


class Mount:
    """Mount of the drill on a feed.

    Attributes:
        state: at the last step.
        motion: that the drive of the feed is to make.

    Args:
        parameters: of feed and arm.
        load_spring_rate: k_1 [N/m].
        has_rock: whether there is rock.
    """

    def __init__(
        self, parameters: MountParameters, load_spring_rate: float, has_rock: bool
    ) -> None:
        self._parameters = parameters
        self.motion = STANDSTILL
        start = parameters.initial_feed
        weight = max(0.0, load_spring_rate * start) if has_rock else 0.0
        self.state = MountState(start, start, 0.0, weight, weight, weight > 0.0, 0.0)

    def step(
        self,
        interval: float,
        bottom: float,
        reacting_force: float,
        load_spring_rate: float,
        has_rock: bool,
        disturbances: Disturbances,
    ) -> MountState:
        """Move for one step and return the state at its end.

        Args:
            interval: length of the step [s].
            bottom: depth of the hole [m]; infinite if there is no bottom.
            reacting_force: mean force of the drill on the mount in the step [N].
            load_spring_rate: k_1 [N/m].
            has_rock: whether there is rock.
            disturbances: faults in force.
        """
        return self.state
