"""Check what no other tool looks at; each check below has its subject in its docstring.

`python -m toolchain.check_repository [NAME ...]` needs the environment of env.bash.
"""

from __future__ import annotations

import ast
import io
import json
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from catkin_pkg.package import InvalidPackage, parse_package

from rpud_sim.cli.main import COMMANDS
from rpud_sim.ros.drill.publishers import OF_NODE
from rpud_sim.ros.graph import message_class
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.topics import COMMAND_TOPICS, TOPICS

ROOT = Path(__file__).resolve().parent.parent
# In a release tree the packages are side by side.
_PLACES = (ROOT / "msg_defs", ROOT.parent / "rpud_msgs")
MESSAGES = next(filter(Path.exists, (place / "package.xml" for place in _PLACES)))
# Also where it is tried, and where modules ``msg`` or ``srv`` are imported as a whole.
_INTERFACES = re.compile(
    r"^\s*(?:from|import) (\w+)(?:\.(?:msg|srv|action)\b| import (?:msg|srv|action)\b)",
    re.MULTILINE,
)
_OF_PIP = ("mcap-ros2-support", "python3-rosbags-pip")
# What bloom knows when it evaluates conditions.
_RELEASE = {"ROS_DISTRO": "jazzy", "ROS_VERSION": "2", "ROS_PYTHON_VERSION": "3"}
_NUMBERS = ("double", "boolean", "uint32", "uint64", "string")
MOST_WORDS = 36_000
# Folders whose docstrings, comments and texts are read.
_SOURCES = ("rpud_sim", "bench", "examples", "toolchain", "validation")
_LARGEST = {".webp": 1_500_000, ".png": 350_000, ".svg": 350_000}  # pictures [byte]


def manifests() -> Iterator[str]:
    """Both package.xml, by ROS's own parser; of one version, and with no dependency of pip alone.

    Each interface package that a module imports must be a dependency: what a drill offers must not
    depend on what else is installed. Every message and service is built.
    """
    for manifest in (ROOT / "package.xml", MESSAGES):
        warnings: list[str] = []
        try:
            package = parse_package(manifest, warnings=warnings)
        except InvalidPackage as error:
            yield f"{manifest}: {error}"
            continue
        yield from (f"{manifest}: {text}" for text in warnings)
        package.evaluate_conditions(_RELEASE)
        for each in (*package.exec_depends, *package.build_depends):
            if each.evaluated_condition and each.name in _OF_PIP:
                yield f"{manifest}: {each.name}, which only pip has, needs a condition"
    trees = [ElementTree.parse(each).getroot() for each in (ROOT / "package.xml", MESSAGES)]
    if len({each.findtext("version") for each in trees}) != 1:
        yield f"{MESSAGES} has another version than package.xml"
    declared = {each.text for each in trees[0]}
    for path in sorted((ROOT / "rpud_sim").rglob("*.py")):
        for name in set(_INTERFACES.findall(path.read_text(encoding="utf-8"))) - declared:
            yield f"{path}: imports {name}, which package.xml does not declare"
    folder = MESSAGES.parent
    files = {f"{each.parent.name}/{each.name}" for each in folder.glob("[ms][sr][gv]/*")}
    built = re.findall(r"(?:msg|srv)/\w+\.\w+", (folder / "CMakeLists.txt").read_text())
    yield from (f"{name} is not built, or not there" for name in files ^ {*built})


def circles() -> Iterator[str]:
    """Modules of the package that import each other in a circle, for type checking either."""
    sources = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (ROOT / "rpud_sim").rglob("*.py")
    }
    graph = {name: {*_imported(path)} & sources.keys() - {name} for name, path in sources.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        yield f"modules import each other in a circle: {' -> '.join(error.args[1])}"


def _imported(source: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{each.name}" for each in node.names)


def test_names() -> Iterator[str]:
    """Equal base names of test files: beside an installed ROS, each is imported by its own."""
    files = (each for folder in ("test", "examples") for each in (ROOT / folder).rglob("test_*.py"))
    names = Counter(each.name for each in files)
    yield from (f"two test files have the name {name}" for name, n in names.items() if n > 1)


def layouts() -> Iterator[str]:
    """The layouts for Foxglove and PlotJuggler show topics and fields that there are."""
    config = ROOT / "config"
    for file in sorted(config.glob("foxglove*.json")):
        for kind, panel in json.loads(file.read_text())["configById"].items():
            for path in panel.get("paths", ()):
                topic, field = path["value"].split(".")[:2]
                yield from _unknown(file, topic, field)
            if kind.startswith("Publish!"):
                name = COMMAND_TOPICS.get(panel["topicName"].removeprefix("/rpud/"), "")
                if name.replace("/msg/", "/") != panel["datatype"]:
                    yield f"{file}: {panel['topicName']} is no {panel['datatype']}"
            request = json.loads(panel.get("requestPayload", "{}"))
            if request.get("fault", {}).get("kind", "off") not in KINDS:
                yield f"{file}: there is no fault {request['fault']['kind']}"
    for file in sorted(config.glob("plotjuggler*.xml")):
        tree = ElementTree.parse(file).getroot()
        curves = [str(each.get("name")).rsplit("/", 1) for each in tree.iter("curve")]
        asked = {
            name
            for each in tree.iter("selected_topics")
            for name in each.attrib["value"].split(";")
        }
        if asked != {topic for topic, _ in curves}:
            yield f"{file}: other topics are selected than plotted"
        for topic, field in curves:
            yield from _unknown(file, topic, field)


def _unknown(file: Path, topic: str, field: str) -> Iterator[str]:
    kinds: dict[str, Any] = {**TOPICS, **OF_NODE}
    kind = kinds.get(topic.removeprefix("/rpud/"))
    fields = {} if kind is None else message_class(kind.type).get_fields_and_field_types()
    if fields.get(field) not in _NUMBERS:
        yield f"{file}: {topic} has no number {field}"


def evidence() -> Iterator[str]:
    """Tests, commands, targets of make and files that docs/credibility.md names exist."""
    page = ROOT / "docs" / "credibility.md"
    makefile = (ROOT / "Makefile").read_text()
    rows = re.findall(r"^\| [\w ]+ \| ([0-4]) \| (.*) \|$", page.read_text(), re.MULTILINE)
    if len(rows) != 9:  # eight factors, and the technical review
        yield f"{page} has {len(rows)} factors"
    for level, shown in rows:
        if (shown == "none") != (level == "0"):
            yield f"{page}: level {level} is shown by {shown}"
        for item in re.findall(r"`([^`]+)`", shown):
            (first, *words), (path, _, name) = item.split(), item.partition("::")
            if first == "rpud":
                exists = words[0] in COMMANDS
            elif first == "make":
                exists = f"\n{words[0]}:" in makefile
            else:
                file = ROOT / path
                exists = file.is_file() and (not name or f"def {name}(" in file.read_text())
            if not exists:
                yield f"{page} names {item}, which is gone"


def pictures() -> Iterator[str]:
    """Each picture is shown on a page, or is its dark twin, and is small."""
    texts = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), ROOT / "examples" / "README.md"]
    shown = "".join(each.read_text(encoding="utf-8") for each in texts)
    for path in (ROOT / "docs" / "images").iterdir():
        if path.name not in shown and "_dark." not in path.name:
            yield f"{path} is shown nowhere"
        if path.stat().st_size > _LARGEST[path.suffix]:
            yield f"{path} is larger than {_LARGEST[path.suffix]} bytes"


def requirements() -> Iterator[str]:
    """`make run` installs nothing that only tests and studies need, `make test` no extras."""
    folder = ROOT / "toolchain" / "requirements"

    def named(file: str) -> set[str]:
        text = (folder / file).read_text(encoding="utf-8")
        return set(re.findall(r"^([a-z0-9][a-z0-9._-]*)", text, re.MULTILINE))

    for base, prefix in (("wheels", ""), ("installed_ros", "installed_ros_")):
        locks = [f"{each}.lock" for each in (base, f"{prefix}rest", f"{prefix}extras")]
        drill, rest, extras = map(named, locks)
        wrong = named("drill.in") - drill, drill & rest, (drill | rest) & extras
        # colcon needs pytest
        wrong += named("test.in") - {"pytest"} - rest, named("extras.in") - extras
        yield from (
            f"{' or '.join(locks)}: {name} is in the wrong one" for name in set.union(*wrong)
        )


def words() -> Iterator[str]:
    """No text has a word of ``words.py``, and all pages together are below ``MOST_WORDS``.

    A word is what has a letter or a digit between two spaces, also in code and tables.
    """
    from toolchain import reference  # which a release does not need
    from toolchain.words import EVERYWHERE, PAGES

    plain = {**EVERYWHERE, **PAGES}
    texts = sorted(
        each
        for folder in ("", "docs", "examples")
        for each in (ROOT / folder).glob("**/*.md" if folder else "*.md")
    )
    count = sum(len(re.findall(r"\S*\w\S*", each.read_text(encoding="utf-8"))) for each in texts)
    if count >= MOST_WORDS:
        yield f"all pages together have {count} words, not less than {MOST_WORDS}"
    for page in texts:
        text = re.sub(
            r"```.*?```|`[^`\n]*`|\]\([^)]*\)",
            "",
            page.read_text(encoding="utf-8"),
            flags=re.DOTALL,
        )
        yield from _unplain(page, text, plain)
    for file in sorted(MESSAGES.parent.glob("[ms][sr][gv]/*")):
        comments = "\n".join(re.findall(r"#(.*)", file.read_text(encoding="utf-8")))
        yield from _unplain(file, comments, plain)
    yield from _unplain(ROOT / "rpud --help", reference.commands(), plain)
    for source in sorted(path for folder in _SOURCES for path in (ROOT / folder).rglob("*.py")):
        if source.name == "words.py":
            continue
        for row, text in _texts_of(source.read_text(encoding="utf-8")):
            yield from _unplain(Path(f"{source}:{row}"), text, EVERYWHERE)


def _unplain(file: Path, text: str, patterns: dict[str, str]) -> Iterator[str]:
    line = re.sub(r"\s*\n\s*", " ", text)
    for pattern, plain in patterns.items():
        for found in re.findall(rf"\b(?:{pattern})\b", line):
            yield f"{file}: {found!r}: {plain}"


def _texts_of(source: str) -> Iterator[tuple[int, str]]:
    """Yield comments and texts of a module, without names in double backquotes."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        kinds = (tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", -1))
        if token.type in kinds and " " in token.string.strip():
            yield token.start[0], re.sub(r"``.*?``|\{.*?\}|\w+ is now", "", token.string)


CHECKS = (words, manifests, circles, test_names, layouts, evidence, pictures, requirements)


def main() -> int:
    """Print every complaint of the checks that are named, or of all."""
    chosen = [each for each in CHECKS if each.__name__ in sys.argv[1:]] or CHECKS
    found = [text.replace(f"{ROOT}/", "") for check in chosen for text in check()]
    print("\n".join(found) or f"{len(chosen)} checks of the repository passed")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
