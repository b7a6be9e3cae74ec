"""`rpud watch` and `rpud run --watch`: ports, addresses, signals."""

import urllib.error
import urllib.request

import pytest

import rpud_sim

NAMESPACE = "/cli_watch"


def ask(url, **headers):
    """Status, text, and headers of an answer; no redirection is followed."""

    class Stay(urllib.request.HTTPRedirectHandler):
        def redirect_request(self, *_):
            return None

    opener = urllib.request.build_opener(Stay)
    try:
        with opener.open(urllib.request.Request(url, headers=headers), timeout=60) as answer:
            return answer.status, answer.read().decode(), answer.headers
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode(), error.headers


def test_an_address_for_others_has_a_token(process):
    running = process("rpud", "watch", "--port", "0", "--address", "0.0.0.0")
    found = running.wait_for_line(r"http://[^/]+:(\d+)(/\S+[?&]token=\S+)")
    base = f"http://127.0.0.1:{found[1]}"
    assert (ask(f"{base}{found[2]}")[0], ask(base)[0]) == (302, 403)


def test_a_foreign_address_is_one_line(process):
    running = process("rpud", "watch", "--port", "0", "--address", "192.0.2.1")
    assert running.wait() == 1
    assert running.output == "rpud watch: address '192.0.2.1' is not one of this machine"


@pytest.mark.extended
@pytest.mark.parametrize(
    ("given", "rock"), [((), "limestone"), (("--set", "strata=basalt"), "basalt")]
)
def test_a_drill_brings_its_page_along_and_takes_it_away(process, tmp_path, given, rock):
    bag = tmp_path / "bag"
    words = ("--watch", "0", "--namespace", NAMESPACE, "--quiet", "--record", bag)
    running = process("rpud", "run", *words, *given)
    base = running.wait_for_line(rf"drill {NAMESPACE}: (http://[^/]+)/screen")[1]
    running.wait_for_line("the drill is active")
    assert ask(f"{base}/screen")[0] == 200
    running.interrupt()
    assert running.wait() == 0
    with pytest.raises(urllib.error.URLError):
        ask(f"{base}/screen")
    with rpud_sim.open(bag) as opened:
        assert rock in opened.runs[0].parameters["strata"]  # layers where none are chosen
