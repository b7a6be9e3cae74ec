"""Environment that keeps ROS on loopback; it imports no ROS."""

from __future__ import annotations

import sys
from collections.abc import Mapping, MutableMapping
from pathlib import Path

_WHEELS = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"

# Profile that keeps Fast DDS on loopback, in the folder that this package shares.
PROFILE = Path("config", "fastdds_loopback.xml")


def complete_environment(environment: MutableMapping[str, str], prefix: str = sys.prefix) -> None:
    """Set what is not set, as ``env.bash`` does, so that the wheels of ROS use loopback alone."""
    if _WHEELS not in environment:  # Python sets it at its start where ROS's wheels are
        return
    environment.setdefault("AMENT_PREFIX_PATH", prefix)
    if environment.setdefault(_RANGE, "LOCALHOST") == "LOCALHOST":
        environment.update(loopback_variables(environment, Path(prefix, "share/rpud_sim", PROFILE)))


def loopback_variables(environment: Mapping[str, str], profile: Path | None) -> dict[str, str]:
    """Return the variables that keep ROS on loopback; ``profile`` of Fast DDS is installed."""
    fast_dds = environment.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps")
    given = Path(environment.get(_PROFILES, profile or ""))
    if fast_dds and given.name == PROFILE.name and given.is_file():
        # LOCALHOST opens sockets on every interface; SYSTEM_DEFAULT leaves that to the profile.
        return {_PROFILES: str(given), _RANGE: "SYSTEM_DEFAULT"}
    return {_RANGE: "LOCALHOST"}
