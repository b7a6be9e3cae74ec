"""Build backend of ``pip install .``: setuptools in a copy of the sources.

In the clone itself, setuptools would leave ``build/`` and ``rpud_sim.egg-info/``.
"""

from __future__ import annotations

import gzip
import os
import shutil
import tarfile
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from setuptools import build_meta

_SOURCES = ("CHANGELOG.rst", "LICENSE", "README.md", "config", "launch", "package.xml")
_SOURCES += ("pyproject.toml", "resource")
_SOURCES += ("rpud_sim", "setup.cfg", "setup.py", "urdf")
_KERNELS = Path("rpud_sim", "kernels", "compiled")

Settings = Mapping[str, Any] | None

# What pip calls beside the functions below; an editable installation has to point to the sources.
build_editable = build_meta.build_editable
prepare_metadata_for_build_editable = build_meta.prepare_metadata_for_build_editable


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return nothing more than pyproject.toml; setuptools would write an egg-info for that."""
    return []


def get_requires_for_build_editable(config_settings: Settings = None) -> list[str]:
    """Return nothing, as for a wheel."""
    return []


def build_wheel(
    wheel_directory: str,
    config_settings: Settings = None,
    metadata_directory: str | None = None,
) -> str:
    """Build a wheel and return the name of its file.

    Args:
        wheel_directory: for the wheel.
        config_settings: ``kernels`` is a folder of compiled kernels to put into the wheel.
        metadata_directory: what `prepare_metadata_for_build_wheel` has written.
    """
    settings = dict(config_settings or {})
    kernels = settings.pop("kernels", None)
    with _copy_of_sources():
        if kernels:  # these, and not what has been compiled in the clone over time
            shutil.rmtree(_KERNELS, ignore_errors=True)
            shutil.copytree(kernels, _KERNELS)
        return build_meta.build_wheel(wheel_directory, settings, metadata_directory)


def get_requires_for_build_sdist(config_settings: Settings = None) -> list[str]:
    """Return nothing, as for a wheel."""
    return []


def build_sdist(sdist_directory: str, config_settings: Settings = None) -> str:
    """Build an archive of the sources that pip can build a wheel of, and return its name.

    Two archives of one commit are the same: entries are sorted, without owners, and have one time.
    """
    version = ElementTree.parse("package.xml").getroot().findtext("version")
    name = f"rpud_sim-{version}"
    backend = Path(__file__).relative_to(Path.cwd())
    time = int(os.environ.get("SOURCE_DATE_EPOCH", "315532800"))  # 1980, the first that zip has

    def plain(entry: tarfile.TarInfo) -> tarfile.TarInfo:
        entry.uid = entry.gid = 0
        entry.uname = entry.gname = ""
        entry.mtime, entry.mode = time, 0o755 if entry.isdir() else 0o644
        return entry

    text = backend.read_text(encoding="utf-8")
    with _copy_of_sources() as clone:
        metadata = Path(prepared := tempfile.mkdtemp(), _metadata(prepared), "METADATA")
        shutil.copy(metadata, "PKG-INFO")
        shutil.rmtree(prepared)
        shutil.rmtree(_KERNELS, ignore_errors=True)
        backend.parent.mkdir(exist_ok=True)
        backend.write_text(text, encoding="utf-8")
        path = (clone / sdist_directory / f"{name}.tar.gz").resolve()
        with (
            path.open("wb") as file,
            gzip.GzipFile("", "wb", 9, file, time) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as archive,
        ):
            for each in sorted(path for path in Path().rglob("*") if path.is_file()):
                archive.add(each, f"{name}/{each.as_posix()}", filter=plain)
    return path.name


def _metadata(folder: str) -> str:
    found = build_meta.prepare_metadata_for_build_wheel(folder)
    shutil.rmtree("rpud_sim.egg-info", ignore_errors=True)
    return found


def prepare_metadata_for_build_wheel(
    metadata_directory: str, config_settings: Settings = None
) -> str:
    """Write the metadata of the wheel and return the name of its folder."""
    with _copy_of_sources():
        return build_meta.prepare_metadata_for_build_wheel(metadata_directory, config_settings)


@contextmanager
def _copy_of_sources() -> Iterator[Path]:
    """Work in a copy of what the package consists of, and give the clone; links become files."""
    clone = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="rpud_sim_build_") as folder:
        for name in _SOURCES:
            source = clone / name
            if source.is_dir():
                shutil.copytree(
                    source, Path(folder, name), ignore=shutil.ignore_patterns("__pycache__")
                )
            elif source.exists():
                shutil.copy(source, folder)
        os.chdir(folder)
        try:
            yield clone
        finally:
            os.chdir(clone)
