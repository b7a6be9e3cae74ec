"""Import every module of a package, so that Python keeps what it compiles of all they import.

It does so although ``PYTHONDONTWRITEBYTECODE`` is set, as in many images of containers: each start
would compile everything again, and take twice as long.

``python toolchain/keep_bytecode.py PACKAGE``
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
        with contextlib.suppress(ImportError):
            importlib.import_module(module.name)


if __name__ == "__main__":
    sys.dont_write_bytecode = False
    import_all(sys.argv[1])
