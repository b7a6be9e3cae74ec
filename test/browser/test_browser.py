"""The fixtures of this folder find what they are there to find."""

import contextlib
import os
import subprocess
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest
from browser.pages import PHONE
from support import until

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


def test_a_page_of_a_server_on_this_machine_passes(page_of):
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            found = self.path == "/"
            self.send_response(200 if found else 404)  # the icon that browsers request
            self.end_headers()
            self.wfile.write(GOOD.encode() if found else b"")

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        Thread(target=server.serve_forever).start()
        try:
            page_of(f"http://127.0.0.1:{server.server_port}/").check()
        finally:
            server.shutdown()


MARK = "RPUD_TEST_BROWSER"
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


def test_a_failed_test_leaves_a_screenshot_and_the_next_may_have_a_loop(tmp_path):
    assert "1 failed, 1 passed" in run(tmp_path, "assert page.url == 'x'")
    assert [path.name for path in tmp_path.glob("rpud-artefacts/browser/*/*")] == ["failed_1.png"]


def test_a_test_without_end_is_ended_and_the_next_one_runs(tmp_path):
    printed = run(tmp_path, "page.until('false')", "--timeout=25")
    assert "Timeout" in printed
    assert "1 failed, 1 passed" in printed


def test_without_a_browser_tests_are_skipped_and_in_ci_they_fail(tmp_path):
    nowhere = {"PATH": str(tmp_path), "RPUD_BROWSER": ""}
    printed = run(tmp_path, "pass", "-rs", **nowhere)
    assert "1 passed, 1 skipped" in printed
    assert "no Chromium" in printed
    for required in ({"RPUD_BROWSER": "required"}, {"CI": "true"}):
        printed = run(tmp_path, "pass", **{**nowhere, **required})
        assert "1 passed, 1 error" in printed
        assert "never skipped in CI: no Chromium" in printed


def marked(mark):
    """Return the processes that carry a mark in their environment."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if f"{MARK}={mark}".encode() in (process / "environ").read_bytes():
                found.append(process.name)
    return found


def test_a_browser_ends_with_a_test_run_that_is_killed(tmp_path):
    mark = str(tmp_path)
    body = f"open({str(tmp_path / 'went')!r}, 'w').close(); os.kill(os.getpid(), 9)"
    run(tmp_path, body, **{MARK: mark})
    assert (tmp_path / "went").exists()
    until(lambda: not marked(mark))
