"""Another version of this project beside the present one, so that both can run the same work.

``with checkout(BASE) as base: base.run(["rpud", "verify", bag])`` runs the command of that commit.
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
VERSION_0_1_0 = "f4b7df8"
PLACE = ROOT / "build/bench/checkouts"

_READY = ".ready"
# Search paths that lead to this checkout unless they are changed.
_SEARCH_PATHS = ("PATH", "PYTHONPATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH")
# What a folder on such a path holds, or one to which such a path leads, if it is of this project.
_OURS = (
    "rpud_sim",
    "rpud_msgs",
    "share/rpud_sim",
    "share/rpud_msgs",
    "librpud_msgs__rosidl_generator_py.so",
)


class CheckoutError(Exception):
    """Says in one line why a commit cannot be run."""


class Used(NamedTuple):
    """Processor time and wall time [s] of a command, its peak memory [bytes] and its output."""

    processor: float
    wall: float
    memory: int
    output: str


@dataclass(frozen=True)
class Checkout:
    """Sources of one version with all that their commands need.

    Attributes:
        commit: hash in full; empty for the work tree.
        tree: folder of the sources.
        environment: variables that its processes run with.
    """

    commit: str
    tree: Path
    environment: Mapping[str, str]

    def run(
        self,
        command: Sequence[str | Path],
        *,
        folder: Path | None = None,
        variables: Mapping[str, str] | None = None,
        codes: Sequence[int] = (0,),
    ) -> Used:
        """Run a command of this version until it ends.

        Args:
            command: its words; ``rpud`` and ``python`` as the first mean those of this version.
            folder: where it runs; None for a temporary one.
            variables: more of the environment.
            codes: exit codes that it may end with.

        Raises:
            CheckoutError: if it ends with another exit code.
        """
        words = [*self.words(command)]
        with contextlib.ExitStack() as stack:
            # Python imports from the current folder first, which must not hold another version.
            place = folder or stack.enter_context(tempfile.TemporaryDirectory())
            output = stack.enter_context(tempfile.TemporaryFile())
            errors = stack.enter_context(tempfile.TemporaryFile())
            file = Path(stack.enter_context(tempfile.TemporaryDirectory()), "used.json")
            with subprocess.Popen(
                [sys.executable, str(ROOT / "bench/used.py"), str(file), *words],
                cwd=place,
                env={**self.environment, **(variables or {})},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=errors,
            ) as process:
                try:
                    process.wait()
                except BaseException:
                    process.send_signal(signal.SIGINT)  # it ends the command
                    raise
            output.seek(0)
            errors.seek(0)
            found = json.loads(file.read_text()) if file.exists() else {"code": process.returncode}
            if found["code"] not in codes:
                lines = errors.read().decode(errors="replace").strip().splitlines()
                name = self.commit[:7] or "work tree"
                raise CheckoutError(
                    f"{name}: {' '.join(map(str, command))}: exit code {found['code']}: "
                    f"{lines[-1] if lines else 'no message'}"
                )
            text = output.read().decode(errors="replace")
            return Used(found["processor"], found["wall"], found["memory"], text)

    def words(self, command: Sequence[str | Path]) -> Iterator[str]:
        """Yield the words to start a command with, for callers that start it themselves."""
        first, *others = map(str, command)
        if first == "rpud":
            yield from (sys.executable, "-m", "rpud_sim.cli.main")
        else:
            yield sys.executable if first == "python" else first
        yield from others


@contextlib.contextmanager
def checkout(commit: str, *, messages: bool = False) -> Iterator[Checkout]:
    """Give a commit's version with its kernels compiled.

    It is kept in ``build/bench/checkouts`` under its hash, so that its kernels compile only once.

    Args:
        commit: anything that git finds a commit by.
        messages: also build its messages for ROS, which its nodes need. This takes minutes unless
            its definitions are those of the work tree.

    Raises:
        CheckoutError: if this clone lacks the commit, or it cannot be made to run.
    """
    found = resolve(commit)
    tree = PLACE / found
    PLACE.mkdir(parents=True, exist_ok=True)
    with (PLACE / f"{found}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made = Checkout(found, tree, clean_environment(tree))
        if not (tree / _READY).is_file():
            shutil.rmtree(tree, ignore_errors=True)
            _extract(found, tree)
            _prepare(made)
            (tree / _READY).touch()
        if messages:
            made = Checkout(found, tree, _with_messages(made, _messages(made)))
    yield made


@contextlib.contextmanager
def work_tree(*, messages: bool = False) -> Iterator[Checkout]:
    """Give the present version, as files are now, under the same conditions as ``checkout`` does.

    Args:
        messages: with its messages for ROS, as ``make setup`` built them.

    Raises:
        CheckoutError: if it cannot be made to run.
    """
    made = Checkout("", ROOT, clean_environment(ROOT))
    _prepare(made)
    if messages:
        made = Checkout("", ROOT, _with_messages(made, ROOT / "install/rpud_msgs"))
    yield made


def resolve(commit: str) -> str:
    """Return the hash of a commit in full.

    Raises:
        CheckoutError: if this clone lacks it.
    """
    try:
        found = _git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{commit}^{{commit}}")
    except CheckoutError:
        raise CheckoutError(
            f"commit {commit} is not in this clone, which may be a shallow one: "
            "git fetch --unshallow brings it"
        ) from None
    return found.decode().strip()


def state() -> tuple[str, bool]:
    """Return the hash of the work tree's commit and whether files differ from it.

    The hash is empty where there is no git.
    """
    try:
        return _git("rev-parse", "HEAD").decode().strip(), bool(_git("status", "--porcelain"))
    except CheckoutError:
        return "", False


def _git(*words: str) -> bytes:
    try:
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise CheckoutError(f"git {words[0]}: {error}") from None
    return done.stdout


def _extract(commit: str, tree: Path) -> None:
    with tarfile.open(fileobj=io.BytesIO(_git("archive", "--format=tar", commit))) as archive:
        archive.extractall(tree, filter="data")


def clean_environment(tree: Path) -> dict[str, str]:
    """Return this process's variables, with all that leads to a version of ours replaced."""
    environment = dict(os.environ)
    for name in _SEARCH_PATHS:
        entries = [*filter(None, environment.pop(name, "").split(os.pathsep))]
        environment[name] = os.pathsep.join(entry for entry in entries if not _is_ours(entry))
    made = tree / "build/bench" if tree == ROOT else tree / ".made"
    environment |= {
        "PYTHONPATH": os.pathsep.join(filter(None, [str(tree), environment["PYTHONPATH"]])),
        "PYTHONPYCACHEPREFIX": str(made / "bytecode"),
        "NUMBA_CACHE_DIR": str(made / "numba"),  # 0.1.0 keeps its kernels there
        "XDG_CACHE_HOME": str(made / "cache"),
    }
    # An environment without this one writes bytecode, as a user's does.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    return {name: value for name, value in environment.items() if value}


def _is_ours(entry: str) -> bool:
    """Return whether an entry of a search path leads to a version of this project."""
    path = Path(entry)
    if path.is_relative_to(ROOT):
        return not path.is_relative_to(ROOT / ".venv")
    return any((path / name).exists() for name in _OURS)


def _prepare(version: Checkout) -> None:
    """Compile its kernels, and see that Python imports this version.

    Raises:
        CheckoutError: if it imports another, or does not run.
    """
    found = version.run(["python", "-c", "import rpud_sim; print(rpud_sim.__file__)"]).output
    if not Path(found.strip()).is_relative_to(version.tree):
        raise CheckoutError(f"{version.tree}: Python imports rpud_sim from {found.strip()} instead")
    if (version.tree / "rpud_sim/cli/precompile.py").is_file():
        version.run(["python", "-m", "rpud_sim.cli.precompile"])
    with tempfile.TemporaryDirectory() as folder:
        if version.tree != ROOT:
            bag = Path(folder) / "bag"
            for regime in ("free", "drilling"):
                version.run(["rpud", "simulate", "--regime", regime, "--duration", "0.1"])
            version.run(
                ["rpud", "simulate", "--regime", "drilling", "--duration", "0.2", "--bag", bag]
            )
            version.run(["rpud", "verify", bag])


def _messages(version: Checkout) -> Path:
    """Return the prefix of its messages for ROS; build them if they are not those of ours."""
    ours = ROOT / "install/rpud_msgs"
    if ours.is_dir() and _same_files(version.tree / "msg_defs", ROOT / "msg_defs"):
        return ours
    prefix = version.tree / "install/rpud_msgs"
    if not (version.tree / "install" / _READY).is_file():
        link = version.tree / ".venv"
        if not link.is_symlink():
            link.symlink_to(ROOT / ".venv")
        version.run(
            [
                "bash",
                "-c",
                ". toolchain/ros_env.bash && colcon build --symlink-install "
                "--packages-select rpud_msgs",
            ],
            folder=version.tree,
        )
        (version.tree / "install" / _READY).touch()
    return prefix


def _same_files(first: Path, second: Path) -> bool:
    contents = [
        {path.relative_to(each): path.read_bytes() for path in each.rglob("*") if path.is_file()}
        for each in (first, second)
    ]
    return contents[0] == contents[1]


def _with_messages(version: Checkout, prefix: Path) -> dict[str, str]:
    """Return the variables with a prefix of messages.

    Raises:
        CheckoutError: if nothing is built there.
    """
    packages = [file.parents[1] for file in prefix.glob("**/rpud_msgs/__init__.py")]
    if not packages:
        raise CheckoutError(f"{prefix} has no messages for Python: run 'make setup' first")
    environment = dict(version.environment)
    for name, entry in (
        ("AMENT_PREFIX_PATH", prefix),
        ("LD_LIBRARY_PATH", prefix / "lib"),
        ("PYTHONPATH", packages[0]),
    ):
        others = environment.get(name, "").split(os.pathsep)
        # After the sources of its own.
        index = 1 if name == "PYTHONPATH" else 0
        entries = [*filter(None, [*others[:index], str(entry), *others[index:]])]
        environment[name] = os.pathsep.join(entries)
    return environment
