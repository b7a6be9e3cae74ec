"""Quality of service: what publishers offer, what a recorder requests, what a replay offers."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from rpud_sim.bag.metadata import QosProfile as RecordedProfile

# Messages that may wait in the middleware for the recorder: ten seconds of a 1 kHz topic.
RECORDING_DEPTH = 10_000

# Messages of a replayed topic that may wait for acknowledgement; Fast DDS keeps no more.
REPLAY_DEPTH = 5_000

DEPTH_LIMIT = 2**31 - 1  # greatest depth that the middleware accepts

# Messages that a replayed latched topic keeps; discovery does not show how many it was.
LATCHED_DEPTH = 10


def request_for(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Return the strongest request that every offer satisfies, so that all of them connect."""
    return QoSProfile(
        depth=RECORDING_DEPTH,
        reliability=(
            ReliabilityPolicy.RELIABLE
            if all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
            else ReliabilityPolicy.BEST_EFFORT
        ),
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL
            if all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
            else DurabilityPolicy.VOLATILE
        ),
    )


def is_satisfied(request: QoSProfile, offers: Sequence[QoSProfile]) -> bool:
    weakest = request_for(offers)
    return (
        request.reliability == ReliabilityPolicy.BEST_EFFORT
        or weakest.reliability == ReliabilityPolicy.RELIABLE
    ) and (
        request.durability == DurabilityPolicy.VOLATILE
        or weakest.durability == DurabilityPolicy.TRANSIENT_LOCAL
    )


def recorded_profile(profile: QoSProfile) -> RecordedProfile:
    return RecordedProfile(
        history=profile.history.name.lower(),
        depth=profile.depth,
        reliability=profile.reliability.name.lower(),
        durability=profile.durability.name.lower(),
        deadline=profile.deadline.nanoseconds,
        lifespan=profile.lifespan.nanoseconds,
        liveliness=profile.liveliness.name.lower(),
        liveliness_lease_duration=profile.liveliness_lease_duration.nanoseconds,
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def replay_offer(recorded: Sequence[RecordedProfile]) -> QoSProfile:
    """Return the QoS of a replayed topic: the strongest of each policy that was offered.

    So every subscriber that connected to one of the publishers connects to the replay. Without a
    recorded offer the topic is reliable and volatile.
    """
    latched = any(profile.durability == "transient_local" for profile in recorded)
    depths = [
        min(max(profile.depth, 1), DEPTH_LIMIT)
        for profile in recorded
        if profile.history == "keep_last"
    ]
    default_depth = LATCHED_DEPTH if latched else REPLAY_DEPTH
    reliable = not recorded or any(profile.reliability != "best_effort" for profile in recorded)
    manual = any(profile.liveliness == "manual_by_topic" for profile in recorded)
    offer = QoSProfile(
        # Except for latched topics a depth is only room, which a fast replay needs.
        depth=max(depths, default=default_depth) if latched else max([*depths, default_depth]),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC if manual else LivelinessPolicy.AUTOMATIC,
    )
    if recorded:
        offer.deadline = Duration(nanoseconds=min(profile.deadline for profile in recorded))
        offer.lifespan = Duration(nanoseconds=max(profile.lifespan for profile in recorded))
        offer.liveliness_lease_duration = Duration(
            nanoseconds=min(profile.liveliness_lease_duration for profile in recorded)
        )
    return offer
