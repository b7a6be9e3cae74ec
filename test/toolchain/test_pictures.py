"""Pictures of README and docs are those that `make picture` makes."""

import re
from pathlib import Path

import pytest

pytest.importorskip("playwright")
from toolchain.pictures.__main__ import DRAWINGS, FILES

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "images"
LARGEST = {".webp": 1_500_000, ".png": 350_000, ".svg": 350_000}  # bytes
TEXTS = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), ROOT / "examples" / "README.md"]


def test_each_picture_is_made_and_shown():
    shown = set()
    for text in TEXTS:
        found = re.findall(r'!\[[^\]]*\]\(([^)]*)\)|(?:src|srcset)="([^"]*)"', text.read_text())
        shown |= {Path(one or other).name for one, other in found}
    assert {path.name for path in IMAGES.iterdir()} == set(FILES)
    light = {name for name in FILES if "_dark." not in name}
    assert light <= shown <= set(FILES)


def test_each_picture_is_small():
    sizes = {path: path.stat().st_size for path in IMAGES.iterdir()}
    assert [path for path, size in sizes.items() if size > LARGEST[path.suffix]] == []


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing_is_that_of_the_code(name):
    assert (IMAGES / f"{name}.svg").read_text(encoding="utf-8") == DRAWINGS[name]()
