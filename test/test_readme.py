"""The README is true: commands run, output is what they print, tables are the code's."""

import re
import subprocess
from pathlib import Path

import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from rpud_sim.ros.drill.drill_node import DrillNode
from rpud_sim.simulation import preset
from rpud_sim.simulation.configuration import (
    CHANGEABLE,
    PARAMETERS,
    Configuration,
    Settings,
)

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text()
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")


def blocks(language):
    """Return the fenced blocks of a language, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def shape(line):
    """Return a line with every number, width and folder alike."""
    line = re.sub(r"bags/\S+", "bags/", line.replace("/home/me/rpud_sim/", ""))
    return " ".join(NUMBER.sub("0", line).split())


def run(command, folder):
    """Run a command and return all that it printed, with paths that any reader could have."""
    result = subprocess.run(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert result.returncode == 0, result.stdout
    return result.stdout.replace(f"{folder}/", "")


def cells(line):
    return [cell.strip().strip("`") for cell in line.strip("|").split("|")]


def rows(heading):
    """Return the cells of a table below a heading, without its own head."""
    section = README.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    return [cells(line) for line in lines if not re.match(r"\|[-| ]+$", line)]


@pytest.mark.timeout(240)
def test_every_command_runs_and_prints_what_is_shown(tmp_path):
    for script in blocks("python"):
        name = re.match(r"# (\w+\.py)", script)[1]
        (tmp_path / name).write_text(script)
    printed = [run(["bash", "-euc", block], tmp_path) for block in blocks("bash")]
    texts = blocks("text")
    if (ROOT / ".venv").exists():
        bag = tmp_path / "bags" / "made"
        command = ["make", "--no-print-directory", "run", "DURATION=3", f"BAG={bag}"]
        printed.append(run(command, ROOT).replace(f"{tmp_path}/", ""))
    else:
        texts = texts[1:]  # set up without make, as a ROS workspace
    found = {shape(line) for line in "".join(printed).splitlines()}
    shown = {shape(line) for line in "".join(texts).splitlines() if line != "..."}
    assert shown - found == set()


def test_console_blocks_hold_only_what_cannot_run_here():
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for line in "".join(blocks("console")).splitlines():
        words = line.removeprefix("$ ").split()
        if words[0] == "make":
            assert {word for word in words[1:] if "=" not in word} <= targets
        else:
            assert words[0] in ("ros2", "source"), line


def test_the_tables_of_parameters_are_those_of_the_code():
    def shown(name, settings):
        value = settings.value(name)
        if isinstance(value, bool):
            return str(value).lower()
        return value or "none" if isinstance(value, str) else f"{value:g}"

    drilling = Settings()
    free = Settings(Configuration(preset("free")))
    expected = []
    for name in PARAMETERS:
        default = shown(name, drilling)
        if name != "regime" and shown(name, free) != default:
            default += f" (free: {shown(name, free)})"
        allowed = PARAMETERS[name].allowed
        meaning = allowed.description
        changes = "yes" if name in CHANGEABLE else ""
        expected.append([name, default, allowed.range, changes, meaning])
    text = (ROOT / "docs" / "parameters.md").read_text()
    found = [cells(line) for line in text.splitlines() if line.startswith("| `")]
    assert found == expected


@pytest.fixture
def node():
    rclpy.init()
    clock = Parameter("publish_clock", value=True)
    node = DrillNode(namespace="/rpud", parameter_overrides=[clock])
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
    table = {row[0]: (row[1], row[3]) for row in rows("Topics")[1:]}
    assert table == expected


def test_the_table_of_services_is_that_of_the_node(node):
    found = {
        service.service_name.removeprefix("/rpud/"): (
            f"{service.srv_type.__module__.partition('.')[0]}/{service.srv_type.__name__}"
        )
        for service in node.services
        if "drill_node/" not in service.service_name
    }
    assert {row[0]: row[1] for row in rows("As a device under test")[1:]} == found


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)", document.read_text()):
        assert (document.parent / target).exists(), target
