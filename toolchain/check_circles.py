"""Check that no modules of the package import each other in a circle, for type checking either."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[1]


def imported(source: Path) -> Iterator[str]:
    """Yield the names that a module imports anywhere."""
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{each.name}" for each in node.names)


def main() -> int:
    sources = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (ROOT / "rpud_sim").rglob("*.py")
    }
    graph = {name: {*imported(path)} & sources.keys() - {name} for name, path in sources.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        print(f"modules import each other in a circle: {' -> '.join(error.args[1])}")
        return 1
    print(f"{len(graph)} modules, no circle")
    return 0


if __name__ == "__main__":
    sys.exit(main())
