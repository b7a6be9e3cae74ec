"""Pictures of README and docs are those that `make picture` makes."""

from pathlib import Path

import pytest

pytest.importorskip("playwright")
from toolchain.pictures.__main__ import DRAWINGS, FILES

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "images"


def test_each_picture_is_made():
    assert {path.name for path in IMAGES.iterdir()} == set(FILES)


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing_is_that_of_the_code(name):
    assert (IMAGES / f"{name}.svg").read_text(encoding="utf-8") == DRAWINGS[name]()
