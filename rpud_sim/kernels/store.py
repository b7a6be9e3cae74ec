"""Files of compiled kernels, found by what they were compiled from and for.

A file's name ends with a digest of all that its code depends on: texts of the sources, types of the
arguments, processor, and versions of Python, Numba and LLVM; not times of files, which an
installation changes. A kernel is code that runs: what somebody else may write is not read.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import os
import pickle
import platform
import stat
import sys
import uuid
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

# Level of the x86-64 psABI that Intel has since Haswell (2013) and AMD since Excavator (2015). The
# kernels fuse nothing. With level 2 they are 4 to 7 % slower: its instructions overwrite an
# operand.
BASELINE = "x86-64-v3"

# What the level adds to plain x86-64, by LLVM's names.
BASELINE_FEATURES = frozenset(
    (
        *("cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"),
        *("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
    )
)


@dataclasses.dataclass(frozen=True)
class Target:
    """Processor that kernels are compiled for."""

    cpu: str  # name, as LLVM knows it
    features: str = ""  # further instructions than ``cpu`` implies, as LLVM writes them
    # what this processor lacks of the baseline; empty if the target is the baseline
    lacking: tuple[str, ...] = ()


def choose_target(cpu: str, features: str) -> Target:
    """Return the baseline if a processor's features (``+ssse3,-avx``) have it, otherwise itself."""
    present = {name[1:] for name in features.split(",") if name.startswith("+")}
    lacking = tuple(sorted(BASELINE_FEATURES - present))
    return Target(cpu, features, lacking) if lacking else Target(BASELINE)


@functools.cache
def this_target() -> Target:
    """Return the target on this machine; NUMBA_CPU_NAME and NUMBA_CPU_FEATURES replace it."""
    import llvmlite.binding as llvm
    from numba.core import config
    from numba.core.codegen import get_host_cpu_features

    features = config.CPU_FEATURES
    if features is None:
        features = get_host_cpu_features()
    return choose_target(config.CPU_NAME or llvm.get_host_cpu_name(), features)


def notice(target: Target, store: KernelStore) -> str:
    """Return the line for a process that has to compile kernels."""
    place = store.place()
    if store.rejection:
        cause = store.rejection
    elif target.lacking:
        lacking = ", ".join(target.lacking)
        cause = f"this processor lacks {lacking}, which the installed kernels ({BASELINE}) need"
    else:
        numba = f"Numba {version('numba')}"
        versions = f"Python {platform.python_version()}, {numba}, {target.cpu}"
        cause = f"no compiled kernels for these sources and {versions} were found"
    if place is not None:
        fate = f"they are stored in {place}"
    else:
        folders = " nor ".join(str(folder) for folder in store.folders)
        fate = f"they cannot be stored, because nothing can be written to {folders}"
    return f"compiling the model takes some ten seconds: {cause}; {fate}"


SUFFIX = ".kernel"
_FORMAT = 1  # format of the files
_DIGEST_SIZE = 32  # bytes of SHA-256


def user_folders() -> tuple[Path, ...]:
    """Return the folder of the user's own kernels by the XDG specification; none without a home."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not cache.is_absolute():
        try:
            cache = Path.home() / ".cache"
        except RuntimeError:  # a container may run as a user that it does not know
            return ()
    return (cache / "rpud_sim" / "kernels",)


@functools.cache
def digest_of_sources(files: tuple[Path, ...]) -> str:
    """Return a digest of the names and texts of source files."""
    digest = hashlib.sha256()
    for file in files:
        text = file.read_bytes()
        digest.update(f"{file.name}\0{len(text)}\0".encode())
        digest.update(text)
    return digest.hexdigest()


def kernel_name(function: str, signature: str, cpu: str, options: str, sources: str) -> str:
    """Return the name of a kernel's file; ``sources`` is a digest of all texts it comes from."""
    import llvmlite
    import numba

    python = sys.implementation.cache_tag
    numpy_major = np.__version__.partition(".")[0]
    versions = (_FORMAT, python, numba.__version__, llvmlite.__version__, numpy_major)
    made_from = _digest(repr((function, signature, cpu, options, sources, versions)))
    return f"{function}-{_digest(signature)[:8]}.{python}.{cpu}.{made_from[:24]}{SUFFIX}"


class _RefusedError(OSError):
    """File that is not used; the text is a line."""


@functools.cache
def _package() -> os.stat_result:
    return os.stat(__file__)


def _others_may_write(its: os.stat_result) -> bool:
    """Whether others than this user, root and who writes this package may write a file."""
    own = _package()
    trusted = own.st_mode & stat.S_IWGRP if its.st_gid == own.st_gid else 0
    untrusted = (stat.S_IWGRP | stat.S_IWOTH) & ~trusted
    return its.st_uid not in (os.getuid(), 0, own.st_uid) or bool(its.st_mode & untrusted)


# A FIFO would wait for a writer, and a link may lead to where others write.
_FILE = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
_NEW_FILE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC


def _read_file(path: Path) -> bytes:
    """Return the content of a regular file that no other user may write, as it was opened."""
    with open(os.open(path, _FILE), "rb") as file:
        its = os.fstat(file.fileno())
        if not stat.S_ISREG(its.st_mode):
            raise _RefusedError(f"{path} is not used, because it is not a regular file")
        if _others_may_write(its):
            raise _RefusedError(f"{path} is not used, because other users may write it")
        return file.read()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


class KernelStore:
    """Folders that kernels are read from; a new one goes to the first that can be written to."""

    def __init__(self, folders: Sequence[Path]) -> None:
        self.folders = tuple(folders)
        self.found: list[Path] = []  # files that were read
        self.written: list[Path] = []  # files that were written
        self.lost: list[str] = []  # names of those that could not be written anywhere
        self.rejection = ""  # why the latest rejected file was not used, a line; empty without one

    def read(self, name: str) -> object | None:
        """Return the content of a kernel's file; None if there is none that is whole."""
        for folder in self.folders:
            with self._noting():
                data = _read_file(folder / name)
                digest, body = data[:_DIGEST_SIZE], data[_DIGEST_SIZE:]
                # Machine code that is cut short would end the process.
                if hashlib.sha256(body).digest() != digest:
                    continue
                try:
                    content: object = pickle.loads(body)
                except Exception as error:  # whatever the classes in it raise
                    raise _RefusedError(f"{folder / name} is not used: {error!r}") from error
                self.found.append(folder / name)
                return content
        return None

    def reject(self, name: str, error: Exception) -> None:
        """Note that the kernel that was read last cannot be loaded."""
        self.rejection = f"{self.found.pop().with_name(name)} is not used: {error!r}"

    def write(self, name: str, body: bytes) -> Path | None:
        """Keep a kernel and delete its previous versions; return its file, None without a place."""
        for folder in self.folders:
            if not self._is_usable(folder):
                continue
            with self._noting():
                for each in reversed((folder, *folder.parents)):
                    each.mkdir(mode=0o755, exist_ok=True)
                part = folder / f".{name}.{uuid.uuid4().hex}"
                try:
                    with open(os.open(part, _NEW_FILE, 0o644), "wb") as file:
                        file.write(hashlib.sha256(body).digest() + body)
                    os.replace(part, folder / name)
                finally:
                    part.unlink(missing_ok=True)
                self._drop_previous(folder, name)
                self.written.append(folder / name)
                return folder / name
        self.lost.append(name)
        return None

    def place(self) -> Path | None:
        """Return the folder that new kernels go to; None if there is none."""
        return next(filter(self._is_usable, self.folders), None)

    @staticmethod
    def _is_usable(folder: Path) -> bool:
        """Whether a folder can be written to or made."""
        existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
        return os.access(existing, os.W_OK | os.X_OK) and existing.is_dir()

    @contextlib.contextmanager
    def _noting(self) -> Iterator[None]:
        """Suppress an OSError, and keep the line of a rejection."""
        try:
            yield
        except _RefusedError as error:
            self.rejection = str(error)
        except OSError:
            return

    @staticmethod
    def _drop_previous(folder: Path, name: str) -> None:
        prefix = name.removesuffix(SUFFIX).rpartition(".")[0]
        for previous in folder.glob(f"{prefix}.*{SUFFIX}"):
            if previous.name != name:
                with contextlib.suppress(OSError):
                    previous.unlink()
