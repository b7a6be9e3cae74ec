"""Values that never change, so that copies share them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing_extensions import Self


class Shared:
    """Base of immutable values: a deep copy, such as that of a run, is the value itself."""

    def __deepcopy__(self, memo: dict[int, object]) -> Self:
        return self
