"""``python -m toolchain.release``: make and check all files of a release, and publish nothing.

It builds wheels and an archive of the sources, installs the wheels for each CPython found and
drills with them, and lays both ROS packages side by side, because tools for releases do not look
for a package inside of another one.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path
from xml.etree import ElementTree

from toolchain import backend
from toolchain.dist.messages import with_owner
from toolchain.dist.pythons import find_pythons

ROOT = Path(__file__).resolve().parents[1]
_TWINE = "twine==6.2.0"


def lay_tree(folder: Path) -> None:
    """Write the packages rpud_sim and rpud_msgs beside each other into a folder, without links.

    rpud_sim keeps the definitions of the messages, which its tests read, but not their package.
    """
    git = ["git", "-C", ROOT, "ls-files", "-z"]
    names = subprocess.check_output(git, text=True).rstrip("\0").split("\0")
    for name in names:
        places = [folder / "rpud_sim" / name]
        if name.startswith("msg_defs/"):
            own = folder / "rpud_msgs" / name.removeprefix("msg_defs/")
            places = [own] if own.name in ("package.xml", "CHANGELOG.rst") else [*places, own]
        for place in places:
            place.parent.mkdir(parents=True, exist_ok=True)
            if (ROOT / name).is_dir():  # a link to a folder
                shutil.copytree(ROOT / name, place)
            else:
                shutil.copy(ROOT / name, place)
    shutil.copy(ROOT / "LICENSE", folder / "rpud_msgs")
    manifest = folder / "rpud_msgs" / "package.xml"
    manifest.write_text(with_owner(manifest.read_text(encoding="utf-8")), encoding="utf-8")


def unfinished(version: str) -> list[str]:
    """Return what keeps this work tree from being the release of a version, a line each."""
    found = []
    for path in (ROOT / "CHANGELOG.rst", ROOT / "msg_defs" / "CHANGELOG.rst"):
        text = path.read_text(encoding="utf-8")
        if not re.search(rf"^{re.escape(version)} \(\d{{4}}-\d\d-\d\d\)$", text, re.MULTILINE):
            found.append(f"{path.relative_to(ROOT)} has no section {version}")
        if re.search(r"^Forthcoming$", text, re.MULTILINE):
            found.append(f"{path.relative_to(ROOT)} still has a section Forthcoming")
    if f"version: {version}\n" not in (ROOT / "CITATION.cff").read_text(encoding="utf-8"):
        found.append(f"CITATION.cff does not name {version}")
    if ".example" in (ROOT / "package.xml").read_text(encoding="utf-8"):
        found.append("package.xml has no owner yet: maintainer and url end with .example")
    if subprocess.check_output(["git", "-C", ROOT, "status", "--porcelain", "-uno"]):
        found.append("the work tree has changes that are not committed")
    return found


def main() -> int:
    """Make the release, print what is left to do, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m toolchain.release", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "release")
    out = parser.parse_args().out.resolve()
    version = str(ElementTree.parse(ROOT / "package.xml").getroot().findtext("version"))
    shutil.rmtree(out, ignore_errors=True)
    files = out / "files"
    files.mkdir(parents=True)
    try:
        run = [sys.executable, "-m", "toolchain.dist", "--out", str(files)]
        subprocess.run(run, cwd=ROOT, check=True)
        print(files / backend.build_sdist(str(files)))
        lay_tree(out / "ros")
        print(out / "ros")
        venv.create(out / "venv", with_pip=True)
        pip = [out / "venv" / "bin" / "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, _TWINE], check=True)
        for python in find_pythons([]):  # each installs the wheels, drills, records and proves
            subprocess.run([ROOT / "toolchain/try_wheels.sh", python.executable, files], check=True)
        twine = [out / "venv" / "bin" / "twine", "check", "--strict", *sorted(files.iterdir())]
        subprocess.run(twine, check=True)
    except subprocess.CalledProcessError as error:
        print(f"release: {Path(str(error.cmd[0])).name} failed", file=sys.stderr)
        return 1
    left = unfinished(version)
    print("\n".join(["before you publish:", *(f"- {each}" for each in left)]) if left else "ready")
    print(
        f"to publish:\n  git tag -a {version} -m {version} && git push --tags\n"
        f"  {out / 'venv' / 'bin' / 'twine'} upload {files}/*\n"
        f"  bloom-release --rosdistro jazzy rpud_sim  # of a repository that holds {out / 'ros'}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
