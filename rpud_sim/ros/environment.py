"""Check of the environment that ROS is loaded and started in; it imports no ROS.

The libraries below rclpy end the process, or use the network, where a variable is wrong.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from importlib.machinery import EXTENSION_SUFFIXES, PathFinder
from pathlib import Path
from types import ModuleType
from xml.parsers import expat

from rpud_sim.foundation.options import DOMAIN
from rpud_sim.foundation.quantities import ExpectedError, joined

_RMW = "RMW_IMPLEMENTATION"
_RMW_WANTED = "RCL_ASSERT_RMW_ID_MATCHES"
_FAST_DDS = "rmw_fastrtps_cpp"  # what Jazzy loads where none is named
_DOMAIN = "ROS_DOMAIN_ID"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_RANGES = ("OFF", "LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")
_PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
# Any other value makes ROS print an error of five lines instead of each line of its log.
_FLAGS = (
    "RCUTILS_LOGGING_USE_STDOUT",
    "RCUTILS_LOGGING_BUFFERED_STREAM",
    "RCUTILS_COLORIZED_OUTPUT",
)


class StartError(ExpectedError, RuntimeError):
    """Start of ROS that is not possible as requested; the message is one line."""

    code = 2


def check_before_load(
    environment: Mapping[str, str], folders: Sequence[str], prefix: str = sys.prefix
) -> None:
    """Raise a StartError if rclpy cannot be loaded, or belongs to another ROS.

    ``folders`` are those in which Python looks for modules, ``prefix`` may have the wheels of ROS.
    """
    if rmw := environment.get(_RMW):
        prefixes = [prefix, *environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
        places = [Path(each, "lib") for each in prefixes if each]
        places += [Path(e) for e in environment.get("LD_LIBRARY_PATH", "").split(os.pathsep) if e]
        if not any((place / f"lib{rmw}.so").exists() for place in places):
            raise StartError(
                f"{_RMW} is {rmw:.80}, which is not installed: unset {_RMW}, or set it to "
                f"{_FAST_DDS}"
            )
    loaded = rmw or _FAST_DDS
    if (wanted := environment.get(_RMW_WANTED, "")) not in ("", loaded):
        raise StartError(
            f"{_RMW_WANTED} is {wanted:.80}, and {loaded} is loaded: unset it, or set {_RMW}"
        )
    spec = PathFinder.find_spec("rclpy", list(folders))
    if spec is None or spec.origin is None:
        return
    found = Path(spec.origin).resolve().parent
    wheels = Path(prefix, "share", "rclpy").is_dir()
    place = Path(spec.origin)  # an environment may link to the packages of another one
    own = place.is_relative_to(prefix) or found.is_relative_to(Path(prefix).resolve())
    foreign = wheels and not own
    compiled = (found / f"_rclpy_pybind11{suffix}" for suffix in EXTENSION_SUFFIXES)
    if foreign or not any(each.exists() for each in compiled):
        version = ".".join(map(str, sys.version_info[:2]))
        raise StartError(
            f"PYTHONPATH has another rclpy in front, {found}, which is not for this ROS and Python "
            f"{version}: open a new shell, or unset PYTHONPATH and source env.bash again"
        )


def check_before_start(environment: Mapping[str, str], domain_id: int | None = None) -> None:
    """Raise an error of one line if a variable has a value that a start of ROS must not use."""
    given = environment.get(_DOMAIN, "")
    if domain_id is None and given:
        DOMAIN.check(_DOMAIN, int(given) if given.removeprefix("-").isdecimal() else given)
    if environment.get("ROS_LOCALHOST_ONLY") == "1":
        raise StartError(
            f"ROS_LOCALHOST_ONLY is 1, which replaces {_RANGE} and opens sockets on every "
            f"interface: unset it; without it ROS stays on this machine, too"
        )
    if (reach := environment.get(_RANGE, "")) and reach not in _RANGES:
        raise StartError(f"{_RANGE} is {reach:.80}; it is one of {joined(_RANGES)}")
    for flag in _FLAGS:
        if (value := environment.get(flag, "")) not in ("", "0", "1"):
            raise StartError(f"{flag} is {value:.80}; it is 0 or 1")
    # Fast DDS would continue without a profile, on every interface.
    if (profiles := environment.get(_PROFILES)) and (reason := _fault_of_profiles(profiles)):
        raise StartError(f"{_PROFILES} is {profiles}, and {reason}: unset it")


def _fault_of_profiles(path: str) -> str:
    """Return what is wrong with a file of profiles, as far as it shows without their schema."""
    if not Path(path).is_file():
        return "there is no such file"
    elements: list[str] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, attributes: elements.append(name)
    try:
        parser.Parse(Path(path).read_bytes(), True)
    except OSError as error:
        return f"it cannot be read ({error.strerror})"
    except expat.ExpatError as error:
        return f"it is not XML ({error})"
    has_some = elements[0] in ("dds", "profiles") and "profiles" in elements[:-1]
    return "" if has_some else "it has no profiles"


class CheckOfRclpy:
    """Finder of modules that finds none, and checks the environment before rclpy is loaded.

    Loading it with another middleware ends the process, without an exception.
    """

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        if name == "rclpy":
            check_before_load(os.environ, sys.path)
