"""A picture of the docs is what a reader sees, in light and in dark."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("playwright")
from PIL import Image

from toolchain.pictures.screenshots import chromium, open_in_both, save

pytestmark = pytest.mark.extended

PAGE = """<!DOCTYPE html><title>x</title><style>
body { margin: 0; background: #fff; }
@media (prefers-color-scheme: dark) { body { background: #000; } }
</style><button onclick="document.body.innerHTML = '<div style=height:20px;background:red>'">x
"""


def test_a_page_is_taken_as_it_was_prepared_in_both_schemes(a_browser_is_there, tmp_path):
    (tmp_path / "page.html").write_text(PAGE)
    with chromium() as browser:
        pages = open_in_both(browser, (tmp_path / "page.html").as_uri(), (120, 80))
        for page in pages:
            page.get_by_role("button").click()
        files = save(pages, tmp_path / "out.png")
    assert [file.name for file in files] == ["out.png", "out_dark.png"]
    for file, below in zip(files, [(255, 255, 255), (0, 0, 0)], strict=True):
        with Image.open(file) as image:
            assert image.mode == "P"
            assert image.size == (120, 80)
            colors = image.convert("RGB")
            assert colors.getpixel((60, 10)) == (255, 0, 0)
            assert colors.getpixel((60, 60)) == below


def test_make_picture_says_in_one_line_what_is_missing(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "toolchain.pictures", tmp_path, "screen"],
        env={**os.environ, "PATH": str(tmp_path), "CHROMIUM": ""},
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("pictures: no Chromium")
    assert done.stderr.count("\n") == 1
