"""Check both package.xml with ROS's own parser, in which a warning counts as an error.

They must have one version, and no dependency that only pip has: a rosdistro release may have none.
Each interface package that a module imports must be a dependency: what a drill offers must not
depend on what else is installed.
"""

import re
import sys
from pathlib import Path
from xml.etree import ElementTree

from catkin_pkg.package import InvalidPackage, parse_package

ROOT = Path(__file__).resolve().parent.parent
# In a release tree the packages are side by side.
_PLACES = (ROOT / "msg_defs", ROOT.parent / "rpud_msgs")
_MESSAGES = next(filter(Path.exists, (place / "package.xml" for place in _PLACES)))
MANIFESTS = (ROOT / "package.xml", _MESSAGES)


# Also where it is tried, and where modules ``msg`` or ``srv`` are imported as a whole.
_IMPORT = re.compile(
    r"^\s*(?:from|import) (\w+)(?:\.(?:msg|srv|action)\b| import (?:msg|srv|action)\b)",
    re.MULTILINE,
)

PIP_KEYS = ("mcap-ros2-support", "python3-rosbags-pip")
# What bloom knows when it evaluates conditions.
RELEASE = {"ROS_DISTRO": "jazzy", "ROS_VERSION": "2", "ROS_PYTHON_VERSION": "3"}


def complaints(manifest: Path) -> list[str]:
    """Return what the parser has against a manifest."""
    warnings: list[str] = []
    try:
        package = parse_package(manifest, warnings=warnings)
    except InvalidPackage as error:
        return [str(error)]
    if package.package_format != 3:
        warnings.append(f"is of format {package.package_format}, not 3")
    package.evaluate_conditions(RELEASE)
    warnings += [
        f"a release depends on {each.name}, which only pip has: it needs a condition"
        for each in (*package.exec_depends, *package.build_depends)
        if each.evaluated_condition and each.name in PIP_KEYS
    ]
    return warnings


def undeclared(manifest: Path) -> list[str]:
    """Return the imports of interface packages that a manifest does not declare."""
    declared = {each.text for each in ElementTree.parse(manifest).getroot()}
    return [
        f"{path.relative_to(ROOT)}: imports {name}, of which package.xml says nothing"
        for path in sorted((ROOT / "rpud_sim").rglob("*.py"))
        for name in _IMPORT.findall(path.read_text(encoding="utf-8"))
        if name not in declared
    ]


def main() -> int:
    """Print every complaint with its file."""
    found = [f"{manifest}: {text}" for manifest in MANIFESTS for text in complaints(manifest)]
    found += undeclared(MANIFESTS[0])
    versions = {ElementTree.parse(each).getroot().findtext("version") for each in MANIFESTS}
    if len(versions) != 1:
        found.append(f"{MANIFESTS[1]}: has another version than {MANIFESTS[0]}")
    print("\n".join(found) or "package.xml: both are valid")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
