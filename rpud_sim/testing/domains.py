"""ROS domains that no one else on this machine uses, and the environment of their processes."""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from rpud_sim.ros.environment import PROFILE, loopback_variables

# 101 is the last domain whose ports lie below those that Linux gives to outgoing connections.
_LAST_DOMAIN = 101
_DEFAULT_DOMAINS = (0, 42)  # of ROS, and of env.bash: people use them without a lock
_PARTICIPANTS = 8  # of another program that are looked for in a domain
_ELSEWHERE = ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")


class DomainError(RuntimeError):
    """No ROS domain is free."""


class DomainClaim:
    """ROS domain that is this process's own until it is released, or the process ends.

    A locked file keeps other test runs out. Domains in which a program without a lock runs are
    passed over: its sockets are open. If all domains are in use, it raises a DomainError.
    """

    def __init__(self) -> None:
        folder = Path(tempfile.gettempdir()) / f"rpud_sim_domains_{os.getuid()}"
        folder.mkdir(exist_ok=True)
        theirs = {*_DEFAULT_DOMAINS, *_environment_domain()}
        for domain in range(_LAST_DOMAIN, 0, -1):
            if domain in theirs:
                continue
            lock = (folder / str(domain)).open("w")
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                lock.close()
                continue
            if _is_quiet(domain):
                self.domain = domain
                self._lock = lock
                return
            lock.close()
        raise DomainError(f"all ROS domains are in use: see {folder}")

    def release(self) -> None:
        self._lock.close()


def loopback_environment(domain: int, environ: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the environment of ``env.bash``: ROS stays on loopback, in a domain."""
    environment = {name: value for name, value in environ.items() if name not in _ELSEWHERE}
    environment["ROS_DOMAIN_ID"] = str(domain)
    return environment | loopback_variables(environ, find_profile(environ))


def find_profile(environ: Mapping[str, str] = os.environ) -> Path | None:
    """Return the profile that keeps Fast DDS on loopback; None where it is not installed."""
    prefixes = [*filter(None, environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]
    places = [Path(prefix, "share", "rpud_sim") for prefix in prefixes]
    places.append(Path(__file__).resolve().parents[2])  # a clone
    return next((place / PROFILE for place in places if (place / PROFILE).is_file()), None)


@contextlib.contextmanager
def applied(environment: Mapping[str, str]) -> Iterator[None]:
    """Give this process an environment for a while: ROS reads it when a context begins."""
    before = dict(os.environ)
    wanted = dict(environment)
    if "rclpy" in sys.modules and "FASTRTPS_DEFAULT_PROFILES_FILE" not in before:
        # Fast DDS reads a profile only once, and has perhaps done so.
        wanted.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
        wanted["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    try:
        _replace_environment(wanted)
        yield
    finally:
        _replace_environment(before)


def _replace_environment(wanted: Mapping[str, str]) -> None:
    for name in set(os.environ) - set(wanted):
        del os.environ[name]
    os.environ.update(wanted)


def _environment_domain() -> tuple[int, ...]:
    given = os.environ.get("ROS_DOMAIN_ID", "")
    return (int(given),) if given.isdecimal() else ()


def _is_quiet(domain: int) -> bool:
    first = 7400 + 250 * domain
    unicast = range(first + 10, first + 10 + 2 * _PARTICIPANTS)
    return all(_is_free(port) for port in (first, *unicast))


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", port))
        except OSError:
            return False
    return True
