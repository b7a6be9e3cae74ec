"""The fixtures of this folder find what they are there to find."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from browser.pages import PHONE

pytestmark = pytest.mark.extended

ROOT = Path(__file__).resolve().parents[2]
GOOD = """<!DOCTYPE html><html lang="en"><title>Good</title>
<meta name="viewport" content="width=device-width">
<style>:root { color-scheme: light dark; }</style>
<main><h1>Good</h1><img alt="a dot" src="data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA=">
</main></html>"""


@pytest.fixture
def file(tmp_path):
    def write(body, name="page.html"):
        path = tmp_path / name
        path.write_text(GOOD.replace("</main>", f"{body}</main>"))
        return path

    return write


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_good_page_passes(page_of, file, scheme):
    page = page_of(file(""), width=PHONE, scheme=scheme, reduced_motion=True)
    page.check()
    for query in (f"(prefers-color-scheme: {scheme})", "(prefers-reduced-motion)"):
        assert page.tab.evaluate(f"matchMedia('{query}').matches")
    assert page.keep("good, 1").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("<script>console.error('broken')</script>", "broken"),
        ("<script>undefined.x</script>", "uncaught: .*undefined"),
        ("<img alt='' src='http://example.org/x.png'>", "example.org/x.png"),
        ("<script>new WebSocket('ws://192.0.2.1/')</script>", "192.0.2.1"),
        ("<div style='width: 900px'>wide</div>", "900"),
        ("<svg width='20' height='20'></svg>", "alternative text:\n<svg"),
        (
            "<div id=host></div><script>host.attachShadow({mode: 'open'}).innerHTML = "
            "'<canvas></canvas>'</script>",
            "alternative text:\n<canvas",
        ),
        ("<p style='color: #bbb; background: #fff'>faint</p>", "contrast"),
        ("<button></button>", "discernible text"),
    ],
)
def test_a_bad_page_fails(page_of, file, body, what):
    page = page_of(file(body), width=PHONE)
    with pytest.raises(AssertionError, match=what):
        page.check()


def test_another_machine_is_out_of_reach(page_of, file):
    page = page_of(
        file("<script>fetch('http://example.org/').catch((e) => said = `${e}`)</script>")
    )
    page.until("typeof said === 'string'")
    assert "Failed to fetch" in page.tab.evaluate("said")


SHORT = """
import os
def test_one(page_of, tmp_path):
    (tmp_path / "a.html").write_text("<title>a</title>")
    page = page_of(tmp_path / "a.html")
    {body}
"""


def run(folder, body, *options, **environment):
    """Run a test with the fixtures of this folder and one with an event loop; return the text."""
    (folder / "test_short.py").write_text(SHORT.format(body=body))
    (folder / "test_then.py").write_text(
        "import asyncio\ndef test_two():\n    asyncio.run(asyncio.sleep(0))\n"
    )
    (folder / "conftest.py").write_text("from browser.conftest import *\n")
    (folder / "pytest.ini").write_text("[pytest]\n")
    paths = [str(ROOT), str(ROOT / "test"), os.environ.get("PYTHONPATH", "")]
    without_ci = {name: value for name, value in os.environ.items() if name != "CI"}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options, "."],
        cwd=folder,
        env={**without_ci, "PYTHONPATH": os.pathsep.join(paths), **environment},
        capture_output=True,
        text=True,
    )
    return done.stdout + done.stderr


def test_a_failed_test_leaves_a_screenshot_and_the_next_may_have_a_loop(
    a_browser_is_there, tmp_path
):
    assert "1 failed, 1 passed" in run(tmp_path, "assert page.url == 'x'")
    assert [path.name for path in tmp_path.glob("rpud-artefacts/browser/*/*")] == ["failed_1.png"]


def test_without_a_browser_tests_are_skipped_and_in_ci_they_fail(tmp_path):
    nowhere = {"PATH": str(tmp_path), "RPUD_BROWSER": ""}
    printed = run(tmp_path, "pass", "-rs", **nowhere)
    assert "1 passed, 1 skipped" in printed
    assert "no Chromium" in printed
    for required in ({"RPUD_BROWSER": "required"}, {"CI": "true"}):
        printed = run(tmp_path, "pass", **{**nowhere, **required})
        assert "1 passed, 1 error" in printed
        assert "never skipped in CI: no Chromium" in printed
