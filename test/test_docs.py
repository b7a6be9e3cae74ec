"""The pages are true: commands run, output is what they print, tables are the code's."""

import contextlib
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from rpud_sim.foundation.verbs import VERBS
from rpud_sim.messages.batch import rows_of
from rpud_sim.ros.drill.drill_node import DrillNode
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run
from toolchain import reference

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "examples" / "README.md",
    *sorted(DOCS.rglob("*.md")),
]
NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")
BLOCK = re.compile(r"^```(\w+(?: about)?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# What no two runs print alike: the time of day, a free port, and how long something took.
VARYING = re.compile(
    r"\b1[789]\d{8}\.\d+|(?<=127\.0\.0\.1:)\d+|(?<=in )\d+(\.\d+)?(?= ?s\b)|"
    r"(?<=real_time_factor )\d+\.\d+"
)


def name_of(page):
    return str(page.relative_to(ROOT))


def blocks(page):
    """Return the fenced blocks of a page in order, each with its language."""
    return BLOCK.findall(page.read_text())


def runs(page):
    return any(language in ("bash", "python") for language, _ in blocks(page))


def content(line):
    """Return a line with widths, folders, times of day and the like alike."""
    line = re.sub(r"bags/\S+", "bags/", line.replace("/home/me/rpud_sim/", ""))
    return VARYING.sub("0", " ".join(line.split()))


def shape(line):
    """Return a line with every number alike, too, and with one of something as with several."""
    return re.sub(r"s\b", "", NUMBER.sub("0", content(line)))


def run(command, folder):
    """Run a command and return all that it printed, with paths that any reader could have."""
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            command, cwd=folder, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            code = process.wait()
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # a block that failed leaves its drill
        output.seek(0)
        printed = output.read()
    assert code == 0, printed
    return printed.replace(f"{folder}/", "")


@pytest.mark.extended
def test_every_command_runs_and_prints_what_is_shown(tmp_path):
    """All pages, in the order of the index and in one folder, as in the clone of a reader.

    Of a block ``text about`` the words count, and the numbers to a factor of two: a live drill or
    this machine gives them.
    """
    for folder in ("config", "examples"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    wrong = [text for page in in_reading_order() if runs(page) for text in tried(page, tmp_path)]
    assert wrong == [], "\n".join(wrong)
    if (ROOT / ".git").exists():  # what a reader makes in the clone disturbs neither git nor lint
        made = {path.name + "/" * path.is_dir() for path in tmp_path.iterdir()}
        new = made - {"config/", "examples/"}
        ignored = subprocess.run(
            ["git", "check-ignore", *new], cwd=ROOT, stdout=subprocess.PIPE, text=True
        )
        assert set(ignored.stdout.split()) == new


def in_reading_order():
    index = re.findall(r"^([a-z/_-]+)$", (DOCS / "index.md").read_text(), re.MULTILINE)
    listed = [ROOT / "README.md", *((DOCS / name).with_suffix(".md") for name in index)]
    return [*listed, *(page for page in PAGES if page not in listed)]


def tried(page, folder):
    """Run the blocks of a page, and yield what went wrong."""
    printed, shown, about, ran = [], [], [], False
    try:
        for language, block in blocks(page):
            source = re.match(r"# (examples/\S+)\n", block)
            if language == "bash":
                printed.append(run(["bash", "-euc", block], folder))
                ran = True
            elif source:
                assert block.removeprefix(source[0]) == (ROOT / source[1]).read_text()
            elif language == "python":
                printed.append(run([sys.executable, "-c", block], folder))
                ran = True
            elif language == "text" and ran:
                shown.append(block)
            elif language == "text about" and ran:
                about.append(block)
            elif language == "text about" and (ROOT / ".venv").exists():  # what `make run` prints
                bag = folder / "bags" / "made"
                command = ["make", "--no-print-directory", "run", "DURATION=10", f"BAG={bag}"]
                printed.append(run(command, ROOT).replace(f"{folder}/", ""))
                about.append(block)
    except AssertionError as error:
        yield f"{name_of(page)}: {error}"
        return
    lines = "".join(printed).splitlines()
    for line in filter(lambda line: line != "...", "".join(shown).splitlines()):
        if content(line) not in map(content, lines):
            yield f"{name_of(page)}: not printed: {line}"
    for line in filter(lambda line: line != "...", "".join(about).splitlines()):
        if not any(is_about(each, line) for each in lines):
            yield f"{name_of(page)}: not printed, nor about it: {line}"


def is_about(printed, shown):
    """Whether two lines have the same words, and numbers that differ less than twofold."""
    if shape(printed) != shape(shown):
        return False
    pairs = zip(*(NUMBER.finditer(content(each)) for each in (printed, shown)), strict=True)
    return all(close(float(a[0]), float(b[0])) for a, b in pairs)


def close(printed, shown):
    """Whether a number is the shown one within a factor of two, or 5 where it is small."""
    return abs(printed - shown) <= max(abs(shown), abs(printed)) / 2 or abs(printed - shown) <= 5


def test_no_two_pages_write_the_same_name():
    """A second page that writes a bag finds that it exists, or judges the bag of the first."""
    written = re.compile(r"(?:--(?:out|bag|record|plots)|cat >|save\()[ \"]+([\w./]+)")
    places = {}
    for page in PAGES:
        text = "".join(block for kind, block in blocks(page) if kind in ("bash", "python", "sh"))
        for name in set(written.findall(text)):
            places.setdefault(name, []).append(name_of(page))
    assert {name: pages for name, pages in places.items() if len(pages) > 1} == {}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_console_blocks_hold_only_what_cannot_run_here(page):
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    console = "".join(block for language, block in blocks(page) if language == "console")
    for line in console.splitlines():
        if not line.startswith("$ "):  # what an endless command prints
            continue
        words = shlex.split(line.removeprefix("$ "))
        if words[0] == "make":
            assert {word for word in words[1:] if "=" not in word} <= targets
        elif words[:3] == ["python", "-m", "pytest"]:  # `make test` or `make test-all` runs it
            assert (ROOT / words[3]).exists()
        elif words[0] == "python":  # so does this, in part
            assert words[1] == "examples/mutants.py"
        else:
            beside = {"--watch", "watch", *VERBS} & set(words)  # of a second terminal
            assert words[0] in ("ros2", "source", "export", "git", "cd") or beside, line


def cells(line):
    return [cell.strip().strip("`") for cell in line.strip("|").split("|")]


def rows(page, heading):
    """Return the cells of the tables between a heading and the next, without their heads."""
    text = (DOCS / page).read_text()
    section = re.split(r"\n#+ ", text.partition(f"# {heading}\n")[2])[0]
    return [cells(line) for line in section.splitlines() if line.startswith("| `")]


@pytest.mark.parametrize("depth", [1, 2000])
def test_the_callbacks_of_lockstep_decide_with_every_impact(depth):
    """Of each step all samples come first, as from an executor that favours them."""
    [block] = [
        text for kind, text in blocks(DOCS / "explanation" / "lockstep.md") if kind == "python"
    ]
    exec(block, scope := {})
    run, node, decided = Run(Plan(Beginning(to_settings({})))), scope["Impacts"](), []
    node.decide = lambda sample: decided.append((sample.impacts, node.count))
    for second in (1, 2):
        heard = {"reacting_force": [], "contact_force": []}
        for _, topic, fields in rows_of(run.advance_to(second * 1_000_000_000)):
            heard.get(topic, []).append(SimpleNamespace(**fields))
        for sample in heard["reacting_force"]:
            node.on_sample(sample)
        assert len(decided) < 100 * second  # impacts are missing
        for impact in heard["contact_force"][-depth:]:
            node.on_impact(impact)
        assert len(decided) == 100 * second
    assert all(impacts <= count for impacts, count in decided)
    assert node.count == decided[-1][0] > 500


def test_the_tables_of_the_documents_are_those_of_the_code():
    marked = reference.pages()
    texts = [page.read_text(encoding="utf-8") for page in marked]
    different = [
        p.name for p, text in zip(marked, texts, strict=True) if reference.filled(text) != text
    ]
    assert different == [], "make reference"
    assert all(f"<!-- table: {name} -->" in "".join(texts) for name in reference.TABLES)


def test_what_a_fault_needs_is_in_words():
    needs = [row[-1] for row in reference.faults()[1:]]
    assert needs
    assert [each for each in needs if not re.fullmatch(r"[a-z ,]*", each)] == []


@pytest.fixture
def node():
    rclpy.init()
    values = {
        "publish_clock": True,
        "publish_robot_description": True,
        "feed_model": "arm",
        "rotation_model": "friction_drive",
        "strata": "sandstone",
    }
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    node = DrillNode(namespace="/rpud", parameter_overrides=overrides)
    node.trigger_configure()
    yield node
    node.trigger_cleanup()
    node.destroy_node()
    rclpy.shutdown()


def test_the_table_of_topics_is_that_of_the_node(node):
    def offered(endpoint):
        package = endpoint.msg_type.__module__.partition(".")[0]
        qos = endpoint.qos_profile
        words = ["reliable" if qos.reliability == ReliabilityPolicy.RELIABLE else "best effort"]
        words += ["transient local"] * (qos.durability == DurabilityPolicy.TRANSIENT_LOCAL)
        words += [f"depth {qos.depth}"]
        return f"{package}/{endpoint.msg_type.__name__}", ", ".join(words)

    own = ("/parameter_events", "/rosout")
    found = {p.topic_name.removeprefix("/rpud/"): offered(p) for p in node.publishers}
    found |= {s.topic_name.removeprefix("/rpud/"): offered(s) for s in node.subscriptions}
    expected = {topic: offer for topic, offer in found.items() if topic not in own}
    table = {row[0]: (row[1], row[3]) for row in rows("reference/topics.md", "Topics")}
    assert table == expected


def test_the_table_of_services_is_that_of_the_node(node):
    found = {
        service.service_name.removeprefix("/rpud/").replace("drill_node/", "~/"): (
            f"{service.srv_type.__module__.partition('.')[0]}/{service.srv_type.__name__}"
        )
        for service in node.services
        if "drill_node/" not in service.service_name or "journal" in service.service_name
    }
    assert {row[0]: row[1] for row in rows("reference/services.md", "Drill")} == found


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_every_page_is_in_the_index():
    index = (DOCS / "index.md").read_text()
    pages = {str(page.relative_to(DOCS).with_suffix("")) for page in DOCS.rglob("*.md")}
    assert pages - {"index"} == set(re.findall(r"^([a-z/_-]+)$", index, re.MULTILINE))
