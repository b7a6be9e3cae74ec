"""The screen as a report: it answers from the frame that the file holds, without a server."""

import base64
from types import SimpleNamespace

import numpy as np
import pytest
from browser_pages import PHONE, SCHEMES, WIDE
from browser_screens import (
    SHARE,
    of_screen,
    page_with_share,
    text_has,
    text_is,
    until_screen,
    view_of,
)

from rpud_sim.foundation.shown_quantities import QUANTITIES, for_browser
from rpud_sim.viewer.frames import encode, plots_of

pytestmark = pytest.mark.extended

END, BINS = 40.0, 4000
GAP = 1000  # bin without a value
RAMP = (np.arange(BINS) + 0.5) * END / BINS  # a value that is its own time


def moment(time):
    count = 200
    motion = np.sin(np.arange(count) / 9).astype(np.float32) * 1e-3
    arrays = dict.fromkeys(("nodal_plane", "actuator", "free_mass", "drill_tool"), motion)
    force = np.zeros(count, np.float32)
    impacts = [[0.004, 1000.0 + time, 2e-5]]
    section = {"time": time, "period": 1e-4, "contact_force": force, "impacts": impacts, **arrays}
    value = {"mean": time, "least": 0.0, "greatest": 2.0 * time, "spark": RAMP[:60]}
    hole = {
        "depth": time * 1e-3,
        "layers": [{"from": 0.0, "to": None, "name": "chalk", "colour": 0}],
        "log": dict.fromkeys(("depth", "rate", "torque"), RAMP[:200] * time * 1e-3),
    }
    return {
        "time": time + 0.02,
        "frame": {"section": section, "numbers": {"peak_force": value}, "hole": hole},
    }


def frame():
    layers = {
        name: {"t": RAMP, "mean": RAMP, "low": RAMP - 1.0, "high": RAMP + 1.0}
        for name in ("peak_force", "reacting_force")
    }
    layers["reacting_force"]["mean"] = np.where(np.arange(BINS) == GAP, np.nan, RAMP)
    layers["peak_force"]["outliers"] = {"t": np.array([7.0]), "v": np.array([90.0]), "more": 0}
    layers["actuator_power"] = {"t": RAMP, "mean": RAMP}
    layers["depth"] = {"t": RAMP, "mean": RAMP * 1e-3}
    return {
        "mode": "frozen",
        "quantities": for_browser(),
        "plots": plots_of(SimpleNamespace(has=layers.__contains__, others=list, is_drill=True)),
        "drill": "/rpud",
        "drills": ["/rpud"],
        "run": 1,
        "now": END,
        "extent": [0.0, END],
        "status": {"state": "stopped", "regime": "drilling"},
        "faults": [],
        "timeline": {"t": RAMP[::4], "low": RAMP[::4], "mean": RAMP[::4], "high": RAMP[::4]},
        "view": {
            "start": 0.0, "end": END, "detail": "overview",
            "band": "5-95 %", "layers": layers,
        },
        "moments": [moment(time) for time in (5.0, 20.0, 35.0)],
        "log": [
            {"time": 0.0, "kind": "run", "text": "a run begins"},
            {"time": 9.0, "kind": "command", "text": "weight on bit 9 N"},
            {"time": 30.0, "kind": "run", "text": "a run begins"},
        ],
        "report": {
            "verdict": "failed",
            "test": "test_a_hard_rock",
            "seed": 7,
            "requirements": ["the drill stays below 20 N"],
            "tables": [
                {"title": "segments", "columns": ["from"] * 40, "rows": [[0.0] * 40, [None] * 40]}
            ],
        },
    }  # fmt: skip


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    data = base64.b64encode(encode(frame())).decode()
    script = f'<script type="application/octet-stream;base64" class="frame">{data}</script></body>'
    text = (SHARE / "screen.html").read_text().replace("</body>", script)
    with page_with_share(tmp_path_factory.mktemp("frozen"), text) as found:
        yield found


@pytest.fixture
def frozen(page_of, address):
    def open_screen(**options):
        page = page_of(address, **options)
        until_screen(page, "screen.seen.view && screen.clock.block")
        return page

    return open_screen


def test_a_zoom_is_cut_from_the_overview(frozen):
    page = frozen()
    assert view_of(page) == [0.0, END]
    assert 200 < of_screen(page, "screen.seen.view.layers.peak_force.t.length") < 1600
    assert of_screen(page, "screen.seen.view.layers.peak_force.outliers.v.length") == 1
    means, lows = of_screen(
        page, "['mean', 'low'].map((name) => Array.from(screen.seen.view.layers.peak_force[name]))"
    )
    times = np.array(of_screen(page, "Array.from(screen.seen.view.layers.peak_force.t)"))
    text_has(page, "[data-plot=peak_force] .key", "mean, widest 5.95 %")
    assert means == pytest.approx(times)  # joined bins keep the mean, and the least
    assert (np.array(lows) < times - 1.0).all()
    gap = of_screen(page, "screen.seen.view.layers.reacting_force.mean.findIndex(Number.isNaN)")
    assert gap == pytest.approx(GAP * len(means) / BINS, abs=1)
    of_screen(page, "screen.zoom(10, 11)")
    until_screen(page, "screen.seen.view.start === 10")
    text_has(page, "[data-plot=peak_force] .key", "mean, 5.95 %")
    found = np.array(of_screen(page, "Array.from(screen.seen.view.layers.peak_force.t)"))
    assert np.diff(found) == pytest.approx(END / BINS)
    assert 9.9 < found[0] < 10.01
    assert 10.99 < found[-1] < 11.1
    page.assert_quiet()


def test_playhead_picks_section_numbers_and_hole_there(frozen):
    page = frozen()
    assert of_screen(page, "screen.playhead.time") == 5.02  # where its numbers are
    text_is(page, "#time", "5.0\N{NO-BREAK SPACE}s")
    of_screen(page, "screen.playhead.seek(40)")
    until_screen(page, "screen.clock.block.time === 35")
    until_screen(page, "screen.clock.rest > 0")  # it is shown once, and rests
    frames = "document.documentElement.dataset.frame"
    before = page.tab.evaluate(frames)
    until_screen(page, "screen.clock.rest > 0.4")
    assert page.tab.evaluate(frames) == before  # nothing is drawn again
    of_screen(page, "screen.playhead.seek(18)")
    until_screen(page, "screen.clock.block.time === 20")
    page.until("document.querySelector('[data-number=peak_force]').dataset.exact === '20'")
    text_is(page, "#section .now:not(.halo)", "20")  # mm
    assert not page.tab.locator("#state").is_visible()  # it is known of the end alone
    page.tab.keyboard.press("n")
    text_has(page, "#found", r"^impact at 20\.004000000 s, 1\.02.kN")
    page.tab.keyboard.press("n")
    until_screen(page, "screen.clock.block.time === 35")
    page.tab.keyboard.press("n")
    text_has(page, "#found", "there is no further impact in this report")


def test_joined_means_are_weighted_by_the_number_of_impacts(frozen):
    page = frozen()
    joined = page.tab.evaluate(
        "import('/share/screen.js').then(({ rpudScreen: { source } }) => {"
        "const answered = source.onFrame; let found;"
        "source.onFrame = ({ view }) => { found = Array.from(view.layers.few.mean); };"
        "const few = { t: [1, 2, 3, 4], mean: [1, 5, 2, 2], count: [3, 1, 1, 1] };"
        "source.held.view.layers.few = few;"
        "source.send({ view: { start: 0, end: 9, width: 4 } });"
        "delete source.held.view.layers.few; source.onFrame = answered; return found; })"
    )
    assert joined == [2.0, 2.0]


def test_a_reset_is_marked_as_a_command_is(frozen):
    page = frozen()
    marked = page.tab.evaluate(
        "import('/share/marks.js').then(({ commandsOf }) => import('/share/screen.js').then("
        "({ rpudScreen }) => commandsOf(rpudScreen.seen).map(({ time }) => time)))"
    )
    assert marked == [9.0, 30.0]


def test_a_jam_of_the_past_is_called_so_at_its_time(frozen):
    page = frozen()
    fault = "{ kind: 'free_mass_jammed', onset: 10, end: 12, active: false }"
    status = "{ state: 'running', regime: 'drilling' }"
    of_screen(page, f"Object.assign(screen.seen, {{ faults: [{fault}], status: {status} }})")
    said = []
    for time in (9, 11, 13):
        of_screen(page, f"(screen.seen.at = {time}, screen.watch())")
        said.append(page.tab.text_content("#doing"))
    assert said == ["drilling", "jammed", "drilling"]


def test_garbage_neither_hides_what_is_sane_nor_leaves_its_box(frozen):
    """One value of seven is a random bit pattern, as of a sensor with the fault ``garbage``."""
    page = frozen(width=PHONE)
    random = np.random.default_rng(1)
    values = RAMP.copy()
    values[::7] = random.integers(0, 2**64, len(values[::7]), np.uint64).view(np.float64)
    sound = np.isfinite(values)
    shown = np.clip(values[sound], -3e38, 3e38).tolist()  # as 32-bit numbers come
    layer = {"t": RAMP[sound].tolist(), "mean": shown}
    page.tab.evaluate(
        "(layer) => import('/share/screen.js').then(({ rpudScreen: screen }) => {"
        "screen.seen.view.layers = { reacting_force: layer, peak_force: layer };"
        "screen.seen.timeline = { ...layer, low: layer.mean, high: layer.mean, of: 'peak_force' };"
        "screen.numbers.draw({ peak_force: { mean: -7.6e35, least: -1e36, greatest: 2,"
        " spark: layer.mean.slice(0, 60) } });"
        "screen.drawTime(); })",
        layer,
    )
    load = "screen.plots.plots.find(({ definition }) => definition.id === 'load')"
    low, high = of_screen(page, f"{load}.ends")
    assert (0.9 * END < high < 3 * END, -END < low <= 0.0) == (True, True)
    low, high = of_screen(page, "screen.timeline.ends")
    assert (0.9 * END < high < 3 * END, -END < low <= 0.0) == (True, True)
    drawn = of_screen(page, f"{load}.plot.data[1].filter((each) => each !== null)")
    assert len(drawn) > 0.8 * BINS  # what is sane, and no line to garbage
    assert max(map(abs, drawn)) < 20 * END
    text_is(page, "[data-number=peak_force]", "garbage")
    output = "document.querySelector('[data-number=peak_force]')"
    assert page.tab.evaluate(f"{output}.scrollWidth <= {output}.clientWidth")
    page.keep("garbage")


def test_an_axis_holds_all_but_garbage_and_what_is_five_times_as_far(frozen):
    page = frozen()
    ends = "(given) => import('/share/quantities.js').then((all) => all.clippedEnds(...given))"
    usual = [float(each) for each in range(1000)]
    for values, greatest in (
        ([*usual, 4000.0], 4000.0),
        ([*usual, 6000.0], 999.0),
        ([1.0] * 100, 1.0),
        ([0.0] * 5000 + [5.0], 5.0),
        ([1.0, 2.0, 1e20], 2.0),
    ):
        assert page.tab.evaluate(ends, [values, 1e9])[1] == greatest


@pytest.mark.parametrize("width", [PHONE, WIDE])
def test_the_verdict_comes_first_and_tables_are_folded(frozen, width):
    page = frozen(width=width)
    assert page.tab.inner_text("#report h2") == "failed \N{MIDDLE DOT} test_a_hard_rock"
    for text in ("the drill stays below 20 N", "seed 7"):
        assert text in page.tab.inner_text("#report")
    assert not page.tab.locator("#details table").count()
    page.tab.get_by_text("values by segment").click()
    words = page.tab.inner_text("#details table").split()  # wider than a phone
    assert words == ["segments", *["from"] * 40, *["0"] * 40, *["\N{EN DASH}"] * 40]
    for scheme in SCHEMES:
        page.show(scheme)
        page.keep(f"frozen_{scheme}")
        page.check()


def test_on_paper_nothing_is_cut_and_all_is_unfolded(frozen):
    page = frozen()
    page.tab.emulate_media(media="print")
    page.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.tab.locator("#details table").count() > 2
    # A printer lays out once, and no script follows the new width.
    boxes = page.tab.evaluate("""() => {
      document.body.style.width = "700px";
      const figures = [...document.querySelectorAll("#plots > figure:not([hidden]), .strip")];
      const box = (each) => each.getBoundingClientRect();
      const ends = ({ left, top, right, bottom }) => [left, top, right, bottom];
      return figures.map((each) => [ends(box(each)), ends(box(each.querySelector("canvas")))]);
    }""")
    assert len(boxes) >= 4
    bottom = 0.0
    for (_, top, _, end), (left, canvas_top, right, canvas_end) in boxes:
        assert (left >= 0, right <= 700.5, top >= bottom - 0.5) == (True, True, True)
        assert (top <= canvas_top, canvas_end <= end + 0.5) == (True, True)
        bottom = end
    page.tab.evaluate("dispatchEvent(new Event('afterprint'))")
    assert not page.tab.locator("#details details[open]").count()
    page.tab.evaluate("document.body.style.width = ''")


def test_a_value_reads_as_in_the_terminal(frozen):
    page = frozen()
    values = [
        0.0,
        1.247e-96,
        3.3e-7,
        -2.5e-5,
        0.0123,
        0.9996,
        7.0,
        -123.456,
        98765.4,
        1.5e9,
        -7.6e32,
        None,
    ]
    for name, quantity in QUANTITIES.items():
        shown = page.tab.evaluate(
            "([name, values]) => import('/share/quantities.js')"
            ".then(({ valueText }) => values.map((value) => valueText(name, value)))",
            [name, values],
        )
        plain = [
            text.replace("\N{MINUS SIGN}", "-").replace("\N{NO-BREAK SPACE}", " ") for text in shown
        ]
        assert plain == [quantity.text(value) for value in values], name
