"""The progress bar of commands that may take long."""

from __future__ import annotations

import sys
from typing import Any


def progress_bar(
    unit: str, total: float | None = None, *, scaled: bool = False, title: str = ""
) -> Any:
    """Return a ``tqdm`` bar on standard error, to be entered.

    It appears only on a terminal, and only for what takes longer than two seconds.

    Args:
        unit: of what is counted.
        total: at which all is done, where it is known.
        scaled: whether to write large counts with k, M and so on.
        title: of what is done.
    """
    from tqdm import tqdm  # only when it is needed, for it slows every start

    return tqdm(
        desc=title or None,
        unit=unit,
        total=total,
        unit_scale=scaled,
        delay=2.0,
        disable=None,
        leave=False,
        file=sys.stderr,
    )
