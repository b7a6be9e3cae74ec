"""Check what no other tool looks at: package.xml, circles of imports, names of test files."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def equal_test_names() -> list[str]:
    """Return the base names that two test files have.

    Beside an installed ROS launch_testing imports each by its base name.
    """
    names = Counter(
        path.name for folder in ("test", "examples") for path in (ROOT / folder).rglob("test_*.py")
    )
    return [f"two test files have the name {name}" for name, count in names.items() if count > 1]


CHECKS = (equal_test_names,)


def main() -> int:
    """Print every complaint."""
    found = [text for check in CHECKS for text in check()]
    print("\n".join(found) or "repository: all checks passed")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
