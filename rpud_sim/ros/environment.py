"""Environment of ROS where its wheels are installed and nobody has sourced ``env.bash``."""

from __future__ import annotations

import sys
from collections.abc import MutableMapping
from pathlib import Path

_WHEELS = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
_LOOPBACK = "share/rpud_sim/config/fastdds_loopback.xml"


def complete_environment(environment: MutableMapping[str, str], prefix: str = sys.prefix) -> None:
    """Set what is not set, as ``env.bash`` does it, so that ROS uses the loopback interface alone.

    ROS reads these variables when it starts. An installed ROS has set-up files of its own, and its
    environment is left as it is.

    Args:
        environment: of this process, and so of those that it starts.
        prefix: of the virtual environment.
    """
    if _WHEELS not in environment:  # Python sets it at its start where ROS's wheels are
        return
    environment.setdefault("AMENT_PREFIX_PATH", prefix)
    discovery = environment.setdefault(_RANGE, "LOCALHOST")
    profile = Path(prefix, _LOOPBACK)
    if (
        discovery == "LOCALHOST"
        and environment.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps")
        and environment.get(_PROFILES, str(profile)) == str(profile)
        and profile.is_file()
    ):
        # LOCALHOST opens sockets on every interface; SYSTEM_DEFAULT leaves that to the profile.
        environment[_PROFILES] = str(profile)
        environment[_RANGE] = "SYSTEM_DEFAULT"
