"""The page on credibility: every test, command and file that it names exists."""

import ast
import re
from pathlib import Path

import pytest

from rpud_sim.cli.main import COMMANDS

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "credibility.md").read_text()
EIGHT = {
    "Data pedigree",
    "Verification",
    "Validation",
    "Input pedigree",
    "Uncertainty characterization",
    "Results robustness",
    "Use history",
    "Process and product management",
}


def table(heading):
    section = re.split(r"\n#+ ", PAGE.partition(f"# {heading}\n")[2])[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")][1:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


LEVELS = table("Levels")
EVIDENCE = sorted({item for row in LEVELS for item in re.findall(r"`([^`]+)`", row[2])})


def exists(evidence):
    """Return whether a test, a command, a target of make or a file exists."""
    words = evidence.split()
    if words[0] == "rpud":
        return words[1] in COMMANDS
    if words[0] == "make":
        return re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
    path, _, name = evidence.partition("::")
    if not (ROOT / path).is_file():
        return False
    if not name:
        return True
    functions = ast.parse((ROOT / path).read_text()).body
    return name in {item.name for item in functions if isinstance(item, ast.FunctionDef)}


@pytest.mark.parametrize("evidence", EVIDENCE)
def test_the_evidence_exists(evidence):
    assert exists(evidence), f"docs/credibility.md names {evidence}, which is gone"


def test_every_factor_has_its_level_its_evidence_and_its_gap():
    assert {row[0] for row in LEVELS} == EIGHT | {"Technical review"}
    for factor, level, shown in LEVELS:
        assert level in ("0", "1", "2", "3", "4"), factor
        assert (shown == "none") == (level == "0"), factor
