"""The recipes for CI call only what exists, and run as far as they can without a container."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from rpud_sim.cli.main import COMMANDS

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "ci.md").read_text(encoding="utf-8")
OF_USERS, OF_PROJECT = "of users", "of the project"


def instructions(dockerfile):
    """Return the instructions of a Dockerfile with their arguments, without comments."""
    lines = re.sub(r"\\\n\s*", "", dockerfile).splitlines()
    parts = (line.partition(" ") for line in lines if line and not line.startswith("#"))
    return [(word, rest.strip()) for word, _, rest in parts]


def content(name):
    """Return a recipe for users by its file's name, as the page has it."""
    found = [
        text.partition("\n")[2]
        for language in ("yaml", "dockerfile", "json")
        for text in re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
        if text.partition("\n")[0].lstrip("#/ ") == name
    ]
    assert len(found) == 1
    return found[0]


GITHUB = {
    OF_USERS: content(".github/workflows/mission.yml"),
    OF_PROJECT: (ROOT / ".github/workflows/ci.yml").read_text(),
}
GITLAB = {OF_USERS: content(".gitlab-ci.yml"), OF_PROJECT: (ROOT / ".gitlab-ci.yml").read_text()}
DOCKER = {OF_USERS: content("Dockerfile"), OF_PROJECT: (ROOT / "Dockerfile").read_text()}
DEVCONTAINER = {
    OF_USERS: content(".devcontainer/devcontainer.json"),
    OF_PROJECT: (ROOT / ".devcontainer/devcontainer.json").read_text(),
}


def github_steps(whose):
    jobs = yaml.safe_load(GITHUB[whose])["jobs"]
    return [step for job in jobs.values() for step in job["steps"]]


def shell_steps(whose):
    """Return every shell step of all recipes."""
    found = [step["run"] for step in github_steps(whose) if "run" in step]
    for job in yaml.safe_load(GITLAB[whose]).values():
        found += [*job.get("before_script", ()), *job["script"]]
    for word, argument in instructions(DOCKER[whose]):
        if word == "RUN":
            found.append(argument)
        elif word == "CMD":
            found.append(shlex.join(json.loads(argument)))
    found += filter(None, [json.loads(DEVCONTAINER[whose]).get("postCreateCommand")])
    return found


def commands(step):
    """Yield the words of each command of a shell step."""
    for command in re.split(r"&&|;|\n", step):
        yield shlex.split(command)


def check_command(words):
    """Check that what a command calls exists here."""
    words = words[1:] if words[0] == "sudo" else words
    program = Path(words[0]).name if words[0].startswith("/venv/bin/") else words[0]
    if program == "make":
        text = (ROOT / "Makefile").read_text()
        for target in words[1:]:
            assert re.search(rf"^{re.escape(target)}:", text, re.MULTILINE), target
    elif program == "rpud":
        assert words[1] in COMMANDS
        shown = subprocess.run(
            [sys.executable, "-m", "rpud_sim.cli.main", words[1], "--help"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        assert all(word in shown for word in words[2:] if word.startswith("--"))
    elif program == "pip":
        requirement = next(word for word in words if word.startswith("rpud_sim["))
        extras = re.search(r"\[(.*)\]", requirement)[1].split(",")
        setup = (ROOT / "setup.py").read_text().partition("extras_require")[2]
        for extra in extras:
            assert f'"{extra}": [' in setup, f"no extra {extra}"
    elif program.startswith("."):
        assert os.access(ROOT / program, os.X_OK)
    elif program == "python":
        assert words[1] == "-m"
        assert words[2] in ("venv", "pytest")
        if words[2] == "pytest":
            options = ["-n", "--junitxml"]
            assert {word for word in words[3:] if word.startswith("-")} <= set(options)
    elif program == "apt-get":
        assert words[1] in ("update", "install")
    else:
        assert words[:2] == ["rm", "-rf"], words


@pytest.mark.parametrize("whose", [OF_USERS, OF_PROJECT])
def test_every_command_exists(whose):
    steps = shell_steps(whose)
    assert len(steps) > 5
    for step in steps:
        subprocess.run(["bash", "-n", "-c", step], check=True)
        for words in commands(step):
            check_command(words)


def test_the_project_s_first_stage_has_all_that_its_step_needs(tmp_path):
    """A dry run of make with what the stage has copied: a missing file ends it."""
    made = []
    for word, argument in instructions(DOCKER[OF_PROJECT]):
        if word == "FROM" and made:
            break
        if word == "COPY":
            *sources, place = argument.split()
            for source in sources:
                target = tmp_path / place / (source if place == "./" else "")
                if (ROOT / source).is_dir():
                    ignored = shutil.ignore_patterns("__pycache__")
                    shutil.copytree(ROOT / source, target, ignore=ignored)
                else:
                    shutil.copy(ROOT / source, target)
        elif word == "RUN" and argument.startswith("make"):
            made = shlex.split(argument.partition("&&")[0])
            done = subprocess.run(
                [*made, "--dry-run", "ROS_PREFIX="], cwd=tmp_path, capture_output=True, text=True
            )
            assert done.returncode == 0, done.stderr
            assert "colcon build" in done.stdout
    assert made
