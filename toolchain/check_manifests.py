"""Check both package.xml with ROS's own parser, in which a warning counts as an error."""

import sys
from pathlib import Path

from catkin_pkg.package import InvalidPackage, parse_package

ROOT = Path(__file__).resolve().parent.parent
MANIFESTS = (ROOT / "package.xml", ROOT / "msg_defs" / "package.xml")


def complaints(manifest: Path) -> list[str]:
    """Return what the parser has against a manifest."""
    warnings: list[str] = []
    try:
        package = parse_package(manifest, warnings=warnings)
    except InvalidPackage as error:
        return [str(error)]
    if package.package_format != 3:
        warnings.append(f"is of format {package.package_format}, not 3")
    return warnings


def main() -> int:
    """Print every complaint with its file."""
    found = [f"{manifest}: {text}" for manifest in MANIFESTS for text in complaints(manifest)]
    print("\n".join(found) or "package.xml: both are valid")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
