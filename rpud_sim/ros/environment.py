"""Environment of ROS where its wheels are installed and ``env.bash`` has not been sourced."""

from __future__ import annotations

import sys
from collections.abc import Mapping, MutableMapping
from pathlib import Path
from xml.etree import ElementTree

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


# Joint and link of urdf/rpud_feed.urdf for each model.
_FEED = ("rpud_feed", "rpud_rail")
_ROTATION = ("rpud_rotation", "rpud_bit")


def robot_description(folder: Path, feed: bool = False, rotation: bool = False) -> str:
    """Return the URDF of the drill with the joints of the models that are on."""
    text = (folder / "rpud.urdf").read_text(encoding="utf-8")
    if not (feed or rotation):
        return text
    robot = ElementTree.fromstring(text)
    wanted = {*(_FEED if feed else ()), *(_ROTATION if rotation else ())}
    more = ElementTree.fromstring((folder / "rpud_feed.urdf").read_text(encoding="utf-8"))
    robot.extend(part for part in more if part.get("name") in wanted)
    return ElementTree.tostring(robot, encoding="unicode")
