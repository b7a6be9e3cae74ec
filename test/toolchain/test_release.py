"""What `make release` makes: a tree of both packages, an archive of the sources, equal builds."""

import hashlib
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.packages import find_packages

from toolchain import backend, release

ROOT = Path(__file__).resolve().parents[2]
VERSION = ElementTree.parse(ROOT / "package.xml").getroot().findtext("version")

pytestmark = [
    pytest.mark.skipif(not (ROOT / ".git").exists(), reason="a release is made of a clone"),
    pytest.mark.extended,
]


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tree")
    release.lay_tree(folder)
    return folder


def test_release_tools_find_both_packages_of_one_version_and_owner(tree):
    found = {package.name: package for package in find_packages(str(tree)).values()}
    assert set(found) == {"rpud_sim", "rpud_msgs"}
    owners = [[str(each) for each in package.maintainers] for package in found.values()]
    urls = [[each.url for each in package.urls] for package in found.values()]
    assert {package.version for package in found.values()} == {VERSION}
    assert owners[0] == owners[1]
    assert urls[0] == urls[1] != []


def test_colcon_finds_both_and_nothing_is_a_link(tree):
    assert not [path for path in tree.rglob("*") if path.is_symlink() and "log" not in path.parts]
    environment = {k: v for k, v in os.environ.items() if k != "COLCON_DEFAULTS_FILE"}
    output = subprocess.check_output(["colcon", "list"], cwd=tree, env=environment, text=True)
    assert set(output.splitlines()) == {
        "rpud_msgs\trpud_msgs\t(ros.ament_cmake)",
        "rpud_sim\trpud_sim\t(ros.ament_python)",
    }
    own, copied = (
        {path.name: path.read_text() for path in (tree / place).glob("*.msg")}
        for place in ("rpud_msgs/msg", "rpud_sim/rpud_sim/messages/share/rpud_msgs/msg")
    )
    assert own == copied != {}
    check = tree / "rpud_sim" / "toolchain" / "check_repository.py"
    words = [sys.executable, check, "manifests"]
    assert subprocess.call(words, stdout=subprocess.DEVNULL) == 0


@pytest.mark.filterwarnings("ignore:nodes.Node.traverse:DeprecationWarning")  # by catkin_pkg
@pytest.mark.parametrize("package", ["rpud_sim", "rpud_msgs"])
def test_the_changelog_is_of_catkin_s_form_and_has_every_version(tree, package):
    changelog = get_changelog_from_path(str(tree / package), package)
    versions = [version for version, _, _ in changelog.foreach_version()]
    assert {"0.1.0", "0.2.0", VERSION} <= {*versions}


def test_the_archive_of_the_sources_builds_the_wheel_and_is_the_same_each_time(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(ROOT)
    digests = set()
    for number in range(2):
        (folder := tmp_path / str(number)).mkdir()
        archive = folder / backend.build_sdist(str(folder))
        digests.add(hashlib.sha256(archive.read_bytes()).hexdigest())
    assert len(digests) == 1
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-index", "--no-deps"]
    subprocess.check_call([*pip, "--no-build-isolation", "-w", tmp_path, archive])
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as built:
        names = set(built.namelist())
    sources = {
        f"rpud_sim/{path.relative_to(ROOT / 'rpud_sim')}"
        for path in (ROOT / "rpud_sim").rglob("*.py")
    }
    assert sources <= names
