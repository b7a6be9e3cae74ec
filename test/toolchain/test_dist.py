"""The wheels of `make dist`, in an environment that has ROS as wheels and nothing of the clone."""

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from email import message_from_bytes
from pathlib import Path
from xml.etree import ElementTree

import pytest
from support import PATIENCE, free_of_ros

ROOT = Path(__file__).resolve().parents[2]
VENV = Path(sys.prefix)
OWN = ("rpud",)  # beginnings of the names that only our wheels may bring

pytestmark = pytest.mark.skipif(
    not (VENV / "share" / "rclpy").is_dir(), reason="the wheels stand beside those of ROS"
)


@pytest.fixture(scope="module")
def wheels(tmp_path_factory):
    """Build both wheels for this Python."""
    folder = tmp_path_factory.mktemp("dist")
    words = ("-m", "toolchain.dist", "--python", sys.executable, "--out", folder)
    subprocess.run([sys.executable, *words], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return folder


@pytest.fixture(scope="module")
def environment(tmp_path_factory, wheels):
    """Install both wheels by pip into an environment, beside links to all that they need.

    The links lie where pip would put the files: to install ROS anew would take most of a minute.
    """
    prefix = tmp_path_factory.mktemp("environment")
    venv.create(prefix, symlinks=True)
    site_packages = Path(sysconfig.get_path("purelib")).relative_to(VENV)
    for place in (site_packages, Path("lib"), Path("share")):
        (prefix / place).mkdir(exist_ok=True)
        for entry in (VENV / place).iterdir():
            link = prefix / place / entry.name
            if not entry.name.startswith((*OWN, "python3", "__editable__")) and not link.exists():
                link.symlink_to(entry)
    pip = ("-m", "pip", "--python", prefix, "install", "--quiet", "--no-index", "--no-deps")
    words = (*pip, "--disable-pip-version-check", *wheels.glob("*.whl"))
    subprocess.run([sys.executable, *words], check=True, env=free_of_ros())
    return prefix
