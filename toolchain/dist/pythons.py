"""CPythons of this machine that the messages can be compiled for."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

VERSIONS = ("3.10", "3.11", "3.12", "3.13")
"""Those that the wheels of ROS 2 Jazzy exist for."""

# A Python without its headers can compile nothing.
_PROBE = """
import json, os, sys, sysconfig
header = os.path.join(sysconfig.get_path("include"), "Python.h")
print(json.dumps({
    "executable": os.path.realpath(sys.executable),
    "version": "%d.%d" % sys.version_info[:2],
    "usable": sys.implementation.name == "cpython" and os.path.exists(header)
    and not sysconfig.get_config_var("Py_GIL_DISABLED"),
}))
"""


@dataclass(frozen=True)
class Python:
    """A CPython with its headers.

    Attributes:
        executable: absolute path.
        version: such as ``3.11``.
    """

    executable: str
    version: str

    @property
    def tag(self) -> str:
        """Its name in the names of wheels, such as ``cp311``."""
        return "cp" + self.version.replace(".", "")


def find_pythons(chosen: Iterable[str] = ()) -> list[Python]:
    """Return one CPython of each supported version, the oldest version first.

    Args:
        chosen: executables to use instead of those on the search path and of pyenv.
    """
    found: dict[str, Python] = {}
    for executable in list(chosen) or _candidates():
        python = _probe(executable)
        if python is not None:
            found.setdefault(python.version, python)
    return [found[version] for version in VERSIONS if version in found]


def _candidates() -> Iterator[str]:
    yield "python3"
    for version in VERSIONS:
        yield f"python{version}"
    root = Path(os.environ.get("PYENV_ROOT", "~/.pyenv")).expanduser()
    for version in VERSIONS:
        yield from map(str, sorted(root.glob(f"versions/{version}.*/bin/python{version}")))


def _probe(executable: str) -> Python | None:
    """Return the Python, or None if it is absent, unsupported or without headers."""
    try:
        output = subprocess.run(
            [executable, "-c", _PROBE], check=True, capture_output=True, text=True
        ).stdout
    except (OSError, subprocess.CalledProcessError):  # pyenv has names of versions that it hides
        return None
    facts = json.loads(output)
    usable = facts["usable"] and facts["version"] in VERSIONS
    return Python(facts["executable"], facts["version"]) if usable else None
