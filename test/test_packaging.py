"""The two packages as colcon, ROS and pip see them."""

import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ament_index_python.packages import get_package_share_directory

from toolchain import check_repository

ROOT = Path(__file__).resolve().parent.parent


def test_colcon_finds_both_packages_as_ros_packages():
    """A mistake in package.xml would silently make rpud_sim a plain Python package."""
    environment = {k: v for k, v in os.environ.items() if k != "COLCON_DEFAULTS_FILE"}
    output = subprocess.check_output(["colcon", "list"], cwd=ROOT, env=environment, text=True)
    assert set(output.splitlines()) == {
        "rpud_msgs\tmsg_defs\t(ros.ament_cmake)",
        "rpud_sim\t.\t(ros.ament_python)",
    }


def test_the_installed_version_is_that_of_the_manifest():
    own = ElementTree.parse(ROOT / "package.xml").getroot().findtext("version")
    assert version("rpud_sim") == own


@pytest.mark.parametrize(
    ("file", "change", "complaint"),
    [
        ("msg_defs/package.xml", (r"<version>.*<", "<version>9.9.9<"), "has another version than"),
        ("package.xml", (r' condition="[^"]*"', ""), "mcap-ros2-support, which only pip has"),
        (
            "rpud_sim/ros/graph.py",
            ("^", "import nav_msgs.msg\n"),
            "imports nav_msgs, which package.xml does",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # by catkin_pkg
def test_a_manifest_that_is_wrong_is_named(tmp_path, monkeypatch, file, change, complaint):
    for name in ("package.xml", "msg_defs/package.xml", "rpud_sim/ros/graph.py"):
        text = (ROOT / name).read_text()
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(re.sub(*change, text) if name == file else text)
    shutil.copy(ROOT / "msg_defs" / "CMakeLists.txt", tmp_path / "msg_defs")
    for folder in ("msg", "srv"):
        (tmp_path / "msg_defs" / folder).symlink_to(ROOT / "msg_defs" / folder)
    monkeypatch.setattr(check_repository, "ROOT", tmp_path)
    monkeypatch.setattr(check_repository, "MESSAGES", tmp_path / "msg_defs" / "package.xml")
    assert complaint in "\n".join(check_repository.manifests())


@pytest.mark.parametrize(
    "pattern",
    ["launch/*.launch.py", "config/*.*", "config/ros2_control/*", "urdf/*", "package.xml"],
)
def test_data_files_are_installed(pattern):
    share = Path(get_package_share_directory("rpud_sim"))
    files = [path.relative_to(ROOT) for path in ROOT.glob(pattern)]
    assert files
    for file in files:
        assert (share / file).read_text() == (ROOT / file).read_text()


def made_by_setuptools() -> set[Path]:
    """Return what setuptools would leave in the clone."""
    return {*ROOT.glob("*.egg-info"), *ROOT.glob("build/lib*"), *ROOT.glob("build/bdist*")}


@pytest.fixture(scope="module")
def plain_install(tmp_path_factory) -> Path:
    """Install the package with pip, as outside ROS, and return the prefix."""
    prefix = tmp_path_factory.mktemp("prefix")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    before = made_by_setuptools()
    subprocess.check_call([*pip, "--no-build-isolation", "--prefix", prefix, ROOT])
    assert made_by_setuptools() == before
    return prefix


@pytest.mark.extended
def test_pip_installs_the_commands_and_the_configuration(plain_install):
    commands = {path.name for path in (plain_install / "bin").iterdir()}
    assert commands == {"rpud", "drill_node", "recorder", "replayer"}
    share = plain_install / "share" / "rpud_sim"
    assert (share / "package.xml").is_file()
    assert (share / "urdf" / "rpud.urdf").is_file()
    configuration = {path.name for path in (share / "config").iterdir()}
    assert configuration == {path.name for path in (ROOT / "config").iterdir()}


@pytest.mark.extended
def test_links_of_the_description_lead_to_pages_and_pictures_to_files(plain_install):
    (metadata,) = plain_install.rglob("rpud_sim-*.dist-info/METADATA")
    found = set(re.findall(r'(?:\]\(|src="|srcset=")([^)"]+)', metadata.read_text()))
    pictures = {link for link in found if link.endswith((".svg", ".png", ".webp"))}
    assert len(pictures) > 3
    assert [link for link in pictures if "/raw/main/docs/images/" not in link] == []
    pages = found - pictures
    assert pages
    assert [link for link in pages if "/blob/main/" not in link] == []
