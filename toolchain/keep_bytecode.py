"""Import every module of packages, so that Python keeps what it compiles of all they import.

It does so although ``PYTHONDONTWRITEBYTECODE`` is set, as in many images of containers: each start
would compile everything again, and take twice as long.

``python toolchain/keep_bytecode.py PACKAGE ...``
"""

from __future__ import annotations

import contextlib
import importlib
import pkgutil
import sys


def import_all(package: str) -> None:
    """Import all modules of a package; those that lack an optional one of others are left out."""
    found = importlib.import_module(package)
    for module in pkgutil.walk_packages(found.__path__, f"{package}."):
        if not module.name.endswith("__main__"):  # it would run
            with contextlib.suppress(ImportError):
                importlib.import_module(module.name)


if __name__ == "__main__":
    sys.dont_write_bytecode = False
    for package in sys.argv[1:]:
        import_all(package)
