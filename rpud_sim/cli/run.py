"""``rpud run`` and ``rpud watch``: drill in real time, and show drills and bags in a browser.

Recorder and page are separate processes: neither a slow disk nor a page makes the drill late.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.live_line import LiveLine, logging_above, summary_text
from rpud_sim.cli.options import PARAMETERS, PLACE, command, parameter_values
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.foundation.child_process import RPUD, ChildProcess
from rpud_sim.foundation.options import (
    POSITIVE_SECONDS,
    namespace_option,
    option,
    positional,
    run_time_option,
)
from rpud_sim.foundation.quantities import ExpectedError, Quantity
from rpud_sim.foundation.terminal import print_error, printable
from rpud_sim.ros.options import RecordOptions

if TYPE_CHECKING:
    from rpud_sim.ros.client.listening_node import DrillFinder
    from rpud_sim.ros.drill.drill_node import DrillNode
    from rpud_sim.ros.process import StopRequest
    from rpud_sim.viewer.live import LiveStore
    from rpud_sim.viewer.server import PageServer

PORT = Quantity("", "a port", 0, 65535, whole=True)
DEFAULT_PORT = 8810  # as in rpud_sim.viewer.server, which needs Tornado

# Of `--watch`, where no rock is chosen: the screen shows depth, rate and well log within a minute.
WATCHED_STRATA = (
    "{layers: [{depth_from: 0.0, rock: regolith}, {depth_from: 0.004, rock: limestone}, "
    "{depth_from: 0.007, rock: sandstone}]}"
)

_PROGRAM = "rpud run"
_PAGE_START = 60.0  # time for the page's server to start on a busy machine [s]
_PAGE_END = 10.0  # time for it to end [s]
_RECORDER_START = 15.0  # s
_RECORDER_END = 30.0  # s
_NO_BAG = "stopped before the recording began: there is no bag"
_READY = "recording\n"  # printed by the recorder when it records


@command(
    "run",
    "--duration 10 --record bags/first --set weight_on_bit=20",
    "drill in real time on ROS topics",
    "",
    PARAMETERS,
    duration=run_time_option(),
    record=option(
        None, "record the namespace into a new bag, by a recorder process", metavar="DIR", new=True
    ),
    max_loss=option(
        RecordOptions.max_loss,
        "with --record: seconds of messages that a crash loses at most, if processor "
        "and disk keep up (default: %(default)g)",
        POSITIVE_SECONDS,
    ),
    watch=option(
        None,
        "also serve the page of the drill, by a second process; 0 is a free port "
        f"(default: {DEFAULT_PORT}). Without --config, strata and rock_* it drills in three layers",
        PORT,
        nargs="?",
        const=DEFAULT_PORT,
        metavar="PORT",
    ),
    namespace=namespace_option("namespace of the node"),
    allow_duplicate=option(
        False, "start even if a drill of the same name runs; both answer the same requests"
    ),
    quiet=option(False, "no live line of rate and forces"),
)
def _run(options: Any) -> int:
    values = parameter_values(options)
    rocks = options.config or any(name.startswith(("rock_", "strata")) for name in values)
    if options.watch is not None and not rocks:
        values["strata"] = WATCHED_STRATA
    from rpud_sim.ros.drill.drill_node import open_drill
    from rpud_sim.ros.process import StopRequest

    live = not options.quiet
    with (
        StopRequest() as stop,
        _watching(options.watch, options.namespace, stop),
        logging_above(
            live,
            open_drill(
                values,
                options.namespace,
                options.duration,
                allow_duplicate=options.allow_duplicate,
            ),
        ) as node,
    ):
        return drill(node, stop, _PROGRAM, options.record, options.max_loss, live)


def drill(
    node: DrillNode,
    stop: StopRequest,
    program: str,
    record: str | None,
    max_loss: float = RecordOptions.max_loss,
    live: bool = True,
) -> ExitCode:
    """Drill to the end, and print a summary.

    ``record`` is a new bag for the node's namespace. A crash may cost it at most ``max_loss`` of
    messages [s].
    """
    if record:
        return _drill_and_record(node, stop, program, record, max_loss, live)
    drilled = _drill(node, stop, program, live)
    _print_summary(node)
    return ExitCode.DONE if drilled else ExitCode.FAILED


def _on_clock(node: DrillNode) -> bool:
    """Whether its simulation time equals the time on /clock."""
    follows: bool = node.get_parameter("use_sim_time").value
    return follows or node.settings.publish_clock


def _drill_and_record(
    node: DrillNode, stop: StopRequest, program: str, record: str, max_loss: float, live: bool
) -> ExitCode:
    with failing(RuntimeError):
        node.prepare()  # so that the recorder finds its topics, and has the first message
    if stop.wait(0.0):
        print_error(program, _NO_BAG)
        return ExitCode.DONE
    recorder = ChildProcess(
        (
            *(*RPUD, "record", "--out", record, "--namespace", node.get_namespace()),
            # `_missing` compares numbers of messages, which shows more than an empty bag.
            *("--max-loss", str(max_loss), "--allow-empty", "--ready-fd", "1"),
            *(["--use-sim-time"] if _on_clock(node) else ()),
        ),
        errors_apart=True,
    )
    if not recorder.first_line(_RECORDER_START, lambda: stop.requested):
        stopped = stop.requested
        if stopped:
            recorder.end(signal.SIGTERM, seconds=_RECORDER_END)
            if not Path(record).exists():  # the signal came while it started
                print_error(program, _NO_BAG)
                return ExitCode.DONE
        closed = _close_recorder(recorder, record, early=not stopped)
        return ExitCode.DONE if stopped and closed else ExitCode.FAILED
    node.await_recorder(stop)
    try:
        drilled = _drill(node, stop, program, live)
    finally:
        recorded = _close_recorder(recorder, record, early=not recorder.running)
    for line in _missing(record, node.sent) if recorded else ():
        recorded = False
        print_error(program, line)
    _print_summary(node)
    if recorded:
        print(f"bag: {printable(record)}", flush=True)
    return ExitCode.DONE if drilled and recorded else ExitCode.FAILED


def _drill(node: DrillNode, stop: StopRequest, program: str, live: bool) -> bool:
    """Drill to the end; print why it failed, and return whether it did not."""
    from rpud_sim.ros.drill.drill_node import spin

    try:
        with LiveLine(live) as line:
            spin(node, stop, line.show)
    except RuntimeError as error:
        print_error(program, error)
        return False
    return True


def _print_summary(node: DrillNode) -> None:
    print(summary_text(node.totals.values(), node.report, node.faults), flush=True)


def _close_recorder(recorder: ChildProcess, record: str, *, early: bool) -> bool:
    """Stop it, print its summary or its errors, and return whether it recorded until now.

    It has not if it has ended ``early``.
    """
    recorder.end(signal.SIGTERM, seconds=_RECORDER_END)
    print(recorder.output.removeprefix(_READY), end="", flush=True)
    code = recorder.code or 0
    if code == 0:
        if early:
            print_error(_PROGRAM, "the recorder was stopped before the drill")
        return not early
    errors = recorder.errors.splitlines()
    lines = [line for line in errors if line.startswith("rpud")]
    if not lines and code < 0:
        bag = "its bag is truncated" if Path(record).exists() else "there is no bag"
        print_error(_PROGRAM, f"the recorder was ended by signal {-code}; {bag}")
    else:
        print("\n".join(lines or errors[-3:]), file=sys.stderr)
    return False


def _missing(path: str, sent: Mapping[str, int]) -> list[str]:
    """Return a line for each topic with more messages sent than in the closed bag."""
    import rpud_sim.bag
    from rpud_sim.bag import BagError

    try:
        with rpud_sim.bag.open(path) as bag:
            recorded = {item.topic.name: item.message_count for item in bag.topics}
    except BagError as error:
        return [str(error)]
    return [
        f"{name}: {count} messages were sent, {recorded.get(name, 0)} are in the bag"
        for name, count in sorted(sent.items())
        if recorded.get(name, 0) < count
    ]


@contextmanager
def _watching(port: int | None, namespace: str, stop: StopRequest) -> Iterator[None]:
    """Serve the page of a drill meanwhile, and print its address; without a port, no page."""
    if port is None:
        yield
        return
    words = ("watch", "--port", str(port), "--namespace", namespace, "--beside-drill")
    server = ChildProcess((*RPUD, *words), errors_apart=True)
    try:
        line = server.first_line(_PAGE_START, lambda: stop.requested)
        print(line, end="", flush=True)
        if not (line or stop.requested):
            raise ExpectedError(f"the page cannot be served: {_no_page(server)}")
        yield
        if not (server.running or stop.requested):
            print_error(_PROGRAM, "the server of the page ended before the drill")
    finally:
        server.end(signal.SIGTERM, seconds=_PAGE_END)


def _no_page(server: ChildProcess) -> str:
    if server.running:
        return f"nothing within {_PAGE_START:g} s"
    errors = server.errors.strip().splitlines()
    return errors[-1].removeprefix("rpud watch: ") if errors else "it ended"


_SEARCH_TIME = 1.0  # time to look for drills before the addresses are printed [s]
_SEARCH_PERIOD = 0.05  # s


@command(
    "watch",
    "--port 8810",
    "show and command running drills in the browser, or show a bag",
    "With BAG it shows that bag: a timeline, every signal, and exact waveforms rebuilt from the "
    "trajectory. It prints the address of the page, which only this machine can reach without "
    "--address. Other machines need the token in the address.",
    PLACE,
    bag=positional("BAG", "show this bag, a folder or one file, without ROS", nargs="?"),
    port=option(DEFAULT_PORT, "port of the page, 0 for a free one", PORT, metavar="P"),
    address=option("127.0.0.1", "address to listen on; remote ones need the token"),
    open=option(False, "open the page in the browser"),
    beside_drill=option(False, argparse.SUPPRESS),  # `rpud run` starts it with this
)
def _watch(options: Any) -> int:
    return _watch_drills(options) if options.bag is None else _watch_bag(options, options.bag)


def _watch_bag(options: Any, bag: str) -> ExitCode:
    from rpud_sim.viewer.recorded import serve_bag
    from rpud_sim.viewer.server import ListenAddress

    def announce(server: PageServer) -> None:
        url = server.url("/screen")
        print(f"bag {printable(bag)}: {url}", flush=True)
        if options.open:
            _open_browser(url)

    serve_bag(bag, ListenAddress.of(options.port, options.address), announce)
    return ExitCode.DONE


def _watch_drills(options: Any) -> ExitCode:
    from rpud_sim.viewer.live import serve_drills
    from rpud_sim.viewer.server import ListenAddress

    def announce(server: PageServer, store: LiveStore) -> None:
        if options.beside_drill:  # receive all of the run
            store.hear()
        _announce(server, store.finder, options)

    place = ListenAddress.of(options.port, options.address)
    serve_drills(place, options.domain, options.namespace, announce)
    return ExitCode.DONE


def _announce(server: PageServer, finder: DrillFinder, options: Any) -> None:
    drills = [options.namespace] if options.beside_drill else _find(finder) or [options.namespace]
    urls = [server.url("/screen", namespace=drill) for drill in drills]
    for drill, url in zip(drills, urls, strict=True):
        print(f"drill {printable(drill)}: {url}", flush=True)
    if options.open:
        _open_browser(urls[0])


def _find(finder: DrillFinder) -> list[str]:
    end = time.monotonic() + _SEARCH_TIME
    found: list[str] = []
    while time.monotonic() < end:
        found = finder.drills()
        time.sleep(_SEARCH_PERIOD)
    return found


def _open_browser(url: str) -> None:
    """Open a page in the browser of the desktop; report it if there is none."""
    import webbrowser

    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        browser = None
    # A browser in the terminal would take it, and cannot show the page.
    if browser is None or type(browser) is webbrowser.GenericBrowser or not browser.open(url):
        print_error("rpud watch", "no browser found; open the URL manually")
