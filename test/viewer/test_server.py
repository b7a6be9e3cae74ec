"""Server of the screen: whom it answers, what it serves, and how a browser gets frames."""

import hashlib
import http.client
import math
import re
from pathlib import Path

import numpy as np
import pytest
from frame_reader import decode
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from screen_client import ClosedError, ScreenClient, serving

import rpud_sim.viewer
from rpud_sim.foundation.quantities import ExpectedError, ParameterError
from rpud_sim.viewer.frames import View, encode
from rpud_sim.viewer.server import ListenAddress, PageServer

PROXY = "; a proxy in between must keep the header Host"


class Numbers:
    """Store that counts; it has drills ``/a`` and ``/b``."""

    mode = "live"

    def __init__(self):
        self.clients = []
        self.asked = []
        self.views = []

    def open(self, client):
        if client.drill not in ("", "/a", "/b"):
            raise ExpectedError(f"there is no drill in {client.drill}")
        self.clients.append(client.drill)

    def frame(self, client):
        if self.asked and self.asked[-1]["name"] == "break":
            raise ZeroDivisionError("one and\nanother line")
        count = client.sent["count"] = client.sent.get("count", 0) + 1
        fields = {"drill": client.drill, "count": count, "values": np.arange(count)}
        if client.section:
            fields["section"] = {}
        self.views.append(client.view)
        return fields

    def request(self, client, name, content):
        if content["name"] == "no":
            raise ParameterError("no such action")
        self.asked.append(content)


@pytest.fixture
def store():
    return Numbers()


@pytest.fixture
def server(store):
    with serving(store) as running:
        yield running


def answer(server, path="/screen", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    response = connection.getresponse()
    body = response.read()
    connection.close()
    return response, body if "Content-Encoding" in response.headers else body.decode()


def test_every_address_of_this_machine_alone_answers_as_it_is_printed(store):
    with serving(store, address="127.0.0.2") as running:
        assert running.url("/screen").startswith("http://127.0.0.2:")
        connection = http.client.HTTPConnection("127.0.0.2", running.port)
        connection.request("GET", "/screen")
        assert connection.getresponse().status == 200
        connection.close()


def test_the_page_works_below_a_path():
    for file in Path(rpud_sim.viewer.__file__).parent.joinpath("share").glob("*.*"):
        if file.suffix in (".js", ".html", ".css"):
            assert not re.search(r"[\"'`(=]/(frames|share|screen)\b", file.read_text()), file.name


@pytest.mark.parametrize("path", ["/", "/screen", "/share/screen.js", "/frames"])
def test_another_origin_and_another_host_are_refused(server, path):
    for host in ("[", "evil.example", "evil.example:80", "", "[::1"):
        response, body = answer(server, path, Host=host)
        assert (response.status, body) == (403, f"host {host!r} is not this machine{PROXY}\n")
    for origin in ("http://evil.example", "http://[", "null", f"http://127.0.0.1:{server.port}1"):
        response, body = answer(server, path, Origin=origin)
        assert (response.status, body) == (403, f"origin {origin!r} is not this server{PROXY}\n")


@pytest.mark.parametrize(
    ("path", "status"),
    [
        *(("/", 200), ("/share/screen.js", 200), ("/share/x.js", 404), ("/x", 404)),
        *(("/screen?drill=/a", 200), ("/drill?namespace=/a", 404)),
    ],
)
def test_each_answer_forbids_scripts_and_frames_of_others_and_opens_no_drill(
    server, store, path, status
):
    response, _ = answer(server, path)
    assert store.clients == []
    assert response.status == status
    policy = response.headers["Content-Security-Policy"]
    for part in ("default-src 'none'", "script-src 'self'", "frame-ancestors 'none'"):
        assert part in policy
    assert "unsafe" not in policy


@pytest.mark.parametrize(
    "path",
    [
        "/share/../server.py",
        "/share/%2e%2e/server.py",
        "/share/screen.css%00.js",
        "/share/",
    ],
)
def test_nothing_but_the_screen_is_served(server, path):
    assert answer(server, path)[0].status in (403, 404)


def test_others_need_the_token_which_becomes_a_cookie(store):
    with serving(store, token="secret") as server:
        for path in ("/", "/screen", "/share/screen.js", "/frames"):
            response, body = answer(server, path, Host="anything")
            assert (response.status, body.partition(":")[0]) == (403, "the token is missing")
            response, body = answer(server, f"{path}?token=wrong")
            assert (response.status, body.partition(":")[0]) == (403, "this is not its token")
        response, _ = answer(server, "/screen?namespace=/a&token=secret", Host="anything")
        assert (response.status, response.headers["Location"]) == (302, "./screen?namespace=/a")
        cookie = response.headers["Set-Cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        known = {"Host": "anything", "Cookie": cookie.partition(";")[0]}
        assert answer(server, **known)[0].status == 200
        assert answer(server, **known, Origin="http://evil.example")[0].status == 403


# Tornado leaves the socket that it cannot bind to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_port_in_use_is_named():
    with (
        serving(Numbers()) as server,
        pytest.raises(ExpectedError, match=f"port {server.port} of 127.0.0.1 is in use"),
    ):
        PageServer(Numbers(), ListenAddress(server.port))


def test_a_frame_comes_when_the_one_before_was_acknowledged(server, store):
    with ScreenClient(server.port, "?namespace=/a") as client:
        first = client.frame(acknowledge=False)
        assert (first["number"], first["mode"], first["drill"]) == (1, "live", "/a")
        assert first["quantities"][0]["name"] == "impact_rate"
        client.send({"ack": 7})
        client.send({"view": {"follow": 5, "width": 300}})
        client.send({"ack": 1})
        second = client.frame()
        assert second["count"] == 2
        assert "section" not in second  # none was wanted again
        client.send({"section": True})
        client.send({"choices": {"more": "depth"}})
        client.send({"view": {"start": 1, "end": 2.5, "width": 300}})
        client.until(lambda seen: "section" in seen)
        assert store.views[1] == View(5.0, width=300)
        client.until(lambda seen: store.views[-1] == View(None, 1.0, 2.5, 300))
        assert store.clients == ["/a"]


WRONG = (
    "{",
    "[" * 4000,
    "[]",
    "{}",
    {"what": 1},
    {"view": 3},
    {"view": {"follow": 0, "width": 1}},
    {"view": {"start": 2, "end": 1, "width": 1}},
    {"view": {"follow": 5}},
    {"view": {"follow": 5, "width": "wide"}},
    {"playhead": True},
    '{"playhead": NaN}',
    {"playhead": 10**400},
    {"view": {"start": -1e308, "end": 1e308, "width": 1}},
    {"choices": {str(number): "" for number in range(100)}},
    {"seek": "somewhere", "from": 0},
    {"drill": "/b"},
    {"act": 3},
    {"act": "press", "arguments": []},
    " " * 10_000,  # the server reads no more of it
)


@pytest.mark.parametrize("wrong", WRONG, ids=range(len(WRONG)))
def test_what_no_page_sends_closes_the_connection(server, wrong):
    with ScreenClient(server.port) as client:
        client.send(wrong)
        with pytest.raises(ClosedError) as closed:
            client.until(lambda seen: False)
        assert closed.value.args[0] == (1009 if wrong == WRONG[-1] else 1008)


def test_an_action_that_comes_late_is_not_carried_out(server, store, monkeypatch):
    with ScreenClient(server.port) as client:
        number = client.frame()["number"]
        client.send({"act": "go", "frame": number})
        client.until(lambda seen: store.asked)
        monkeypatch.setattr("rpud_sim.viewer.server.EXPIRY", -1.0)
        client.send({"act": "late", "frame": number})
        assert client.until(lambda seen: seen.get("refused"))[1].startswith("expired")
    assert [each["name"] for each in store.asked] == ["go"]


def test_a_page_hears_from_the_server_when_nothing_changes(server, store):
    store.frame = lambda client: None
    with ScreenClient(server.port) as client:
        assert [client.frame()["number"] for _ in range(3)] == [1, 2, 3]


def test_a_store_that_fails_ends_the_page_with_a_message(server):
    with ScreenClient(server.port) as client:
        client.frame()
        client.send({"act": "break"})
        error = client.until(lambda seen: seen.get("error"))
        assert error == "the server has failed: ZeroDivisionError: one and another line"
        with pytest.raises(ClosedError):
            client.frame()


times = arrays(np.float64, st.integers(0, 20), elements=st.floats(allow_nan=False))
values = arrays(np.float32, st.integers(0, 20), elements=st.floats(width=32, allow_nan=False))


@given(first=times, second=values, text=st.text(st.characters(min_codepoint=32, max_codepoint=126)))
def test_numbers_arrays_and_texts_come_back(first, second, text):
    found = decode(encode({"a": {"t": first, "v": [second]}, "n": 1, "text": text}))
    assert (found["n"], found["text"]) == (1, text)
    np.testing.assert_array_equal(found["a"]["t"], first)
    np.testing.assert_array_equal(found["a"]["v"][0], second)
    assert (found["a"]["t"].dtype, found["a"]["v"][0].dtype) == (np.float64, np.float32)


def test_arrays_begin_where_a_browser_can_view_them():
    data = encode({"text": "x", "a": np.zeros(3, np.float32), "b": np.ones(2)})
    begin = 4 + int.from_bytes(data[:4], "little")
    assert (len(data) - (begin + -begin % 8)) % 8 == 0


def test_numbers_that_json_has_no_form_for_are_null():
    found = decode(encode({"a": math.nan, "b": [math.inf, np.float64(-math.inf), np.int32(3)]}))
    assert found == {"a": None, "b": [None, None, 3]}


def test_control_characters_of_a_stranger_are_shown_and_not_sent():
    assert "\x1b" not in decode(encode({"kind": "a\x1b[31m"}))["kind"]


VENDOR = Path(rpud_sim.viewer.__file__).parent / "share" / "vendor"


def test_every_file_has_the_digest_that_is_noted():
    noted = dict(re.findall(r"`(\S+)` \| `([0-9a-f]{64})`", (VENDOR / "README.md").read_text()))
    files = {path.name: path for path in VENDOR.iterdir() if path.name != "README.md"}
    assert files.keys() == noted.keys()
    for name, path in files.items():
        assert hashlib.sha256(path.read_bytes()).hexdigest() == noted[name], name
