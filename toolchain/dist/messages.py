"""Wheel of ``rpud_msgs``: the messages as ``make setup`` built them, for each CPython found.

The C libraries are the same for every Python, the module that converts messages is not. The wheel
holds one module for each CPython, and its name lists them. Libraries and definitions lie where
the ROS wheels put theirs: in the ``lib/`` and ``share/`` of the environment.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from toolchain.dist.pythons import Python

ROOT = Path(__file__).resolve().parents[2]
BUILT = ROOT / "install" / "rpud_msgs"
PACKAGE = "rpud_msgs"
_MODULE = f"{PACKAGE}_s__rosidl_typesupport_c"
_INDEX = "share/ament_index/resource_index"


def stage_messages(folder: Path, pythons: Sequence[Python]) -> str:
    """Write the source of the wheel into a folder and return the wheel's tag.

    Args:
        folder: replaced; `messages_setup.py` shows what is where.
        pythons: to compile the module for.

    Raises:
        subprocess.CalledProcessError: if the compiler fails, which prints why.
    """
    shutil.rmtree(folder, ignore_errors=True)
    (generated,) = BUILT.glob(f"lib/python3.*/site-packages/{PACKAGE}")
    for file in generated.rglob("*.py"):
        _copy(file, folder / PACKAGE / file.relative_to(generated))
    for python in pythons:
        _copy(_compile_module(python, generated), folder / PACKAGE)

    # Python needs neither the libraries of C++ nor the one that the modules contain.
    for library in sorted(BUILT.glob(f"lib/lib{PACKAGE}__*.so")):
        if not library.stem.endswith(("_cpp", "_generator_py")):
            _copy(library, folder / "lib" / library.name)
            subprocess.run(["strip", "--strip-unneeded", folder / "lib" / library.name], check=True)
    for kind in ("msg", "srv"):
        for file in sorted((BUILT / "share" / PACKAGE / kind).iterdir()):
            _copy(file, folder / "share" / PACKAGE / kind / file.name)
    for kind in ("packages", "rosidl_interfaces"):
        _copy(BUILT / _INDEX / kind / PACKAGE, folder / _INDEX / kind / PACKAGE)
    manifest = (ROOT / "msg_defs" / "package.xml").read_text(encoding="utf-8")
    (folder / "package.xml").write_text(with_owner(manifest), encoding="utf-8")
    _copy(ROOT / "LICENSE", folder / "LICENSE")
    _copy(Path(__file__).with_name("messages_setup.py"), folder / "setup.py")

    major, minor = _newest_glibc(folder.rglob("*.so"))
    names = ".".join(python.tag for python in pythons)
    tag = f"{names}-none-manylinux_{major}_{minor}_x86_64"
    (folder / "tag").write_text(tag)
    return tag


def with_owner(manifest: str) -> str:
    """Return the text of a package.xml with the maintainer and the url of the root's."""
    root = (ROOT / "package.xml").read_text(encoding="utf-8")
    owner = {tag: re.search(rf"  <{tag}.*</{tag}>\n", root) for tag in ("maintainer", "url")}
    assert owner["maintainer"] is not None
    assert owner["url"] is not None
    text = re.sub(r"  <maintainer.*</maintainer>\n", lambda _: owner["maintainer"][0], manifest)
    return re.sub(r"(  <license.*</license>\n)", lambda found: found[0] + owner["url"][0], text)


def _copy(source: Path, target: Path) -> None:
    """Copy a file, and not the link that colcon may have made of it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.is_dir():
        target /= source.name
    shutil.copyfile(source.resolve(), target)


def _compile_module(python: Python, generated: Path) -> Path:
    """Compile the module of one Python and return its file.

    Args:
        python: to compile for.
        generated: folder of the generated C sources.
    """
    build = ROOT / "build" / "dist" / python.tag
    settings = {
        # With its assertions, as colcon builds it: a field of a wrong type must not pass. They
        # name their files, which need not reveal where this folder is.
        "CMAKE_C_FLAGS": f"-O2 -ffile-prefix-map={ROOT}=.",
        "Python3_EXECUTABLE": python.executable,
        "GENERATED": generated,
        "MESSAGES": BUILT,
        "ROS": sys.prefix,
        "NUMPY": np.get_include(),
    }
    for command in (
        ["-S", Path(__file__).parent, "-B", build, *(f"-D{k}={v}" for k, v in settings.items())],
        ["--build", build, "--parallel", str(os.cpu_count())],
    ):
        _run_cmake(command)
    (module,) = build.glob(f"{_MODULE}.*.so")
    return module


def _run_cmake(arguments: list[str | Path]) -> None:
    """Run CMake, and show what it printed only if it fails."""
    # The repair of the ROS wheels' targets would look for NumPy in the Python that is compiled for.
    environment = {k: v for k, v in os.environ.items() if k != "CMAKE_TOOLCHAIN_FILE"}
    done = subprocess.run(["cmake", *arguments], env=environment, capture_output=True, text=True)
    if done.returncode:
        print(done.stdout, done.stderr, sep="", file=sys.stderr)
        done.check_returncode()


def _newest_glibc(libraries: Iterable[Path]) -> tuple[int, int]:
    """Return the newest version of glibc that any of the libraries asks for."""
    output = subprocess.run(
        ["readelf", "--version-info", "--wide", *libraries],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    found = re.findall(r"\bGLIBC_(\d+)\.(\d+)", output)
    # The Python and ROS wheels that these need are of manylinux_2_28 and later.
    return max([(2, 28), *((int(major), int(minor)) for major, minor in found)])
