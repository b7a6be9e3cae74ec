"""The fixtures of this folder find what they are there to find."""

import pytest
from browser_pages import PHONE, require_browser

pytestmark = pytest.mark.extended

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
        ("<div><canvas></canvas></div>", "alternative text:\n<canvas"),
        ("<p style='color: #bbb; background: #fff'>faint</p>", "contrast"),
        ("<button></button>", "discernible text"),
    ],
)
def test_a_bad_page_fails(page_of, file, body, what):
    page = page_of(file(body), width=PHONE)
    with pytest.raises(AssertionError, match=what):
        page.check()


@pytest.mark.parametrize("required", [{}, {"RPUD_BROWSER": "required"}, {"CI": "true"}])
def test_without_a_browser_tests_are_skipped_and_in_ci_they_fail(monkeypatch, tmp_path, required):
    monkeypatch.delenv("CI", raising=False)
    for name, value in {"PATH": str(tmp_path), "RPUD_BROWSER": "", **required}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(pytest.fail.Exception if required else pytest.skip.Exception) as found:
        require_browser()
    assert ("never skipped in CI" in str(found.value)) == bool(required)
    assert "no Chromium" in str(found.value) or "browser.lock" in str(found.value)
