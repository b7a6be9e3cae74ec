"""Results that were used last, within a limit of memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

_Result = TypeVar("_Result")


class Kept(Generic[_Result]):
    """Results by keys; those that were not used for longest are dropped, the latest never is.

    ``size`` says how much of ``most`` a result takes.
    """

    def __init__(self, most: int, size: Callable[[_Result], int]) -> None:
        self._most, self._size = most, size
        self._results: OrderedDict[Hashable, _Result] = OrderedDict()
        self._total = 0

    def get(self, key: Hashable, make: Callable[[], _Result]) -> _Result:
        """Return the result of a key; if it is not kept it is made."""
        if key in self._results:
            self._results.move_to_end(key)
            return self._results[key]
        result = self._results[key] = make()
        self._total += self._size(result)
        while len(self._results) > 1 and self._total > self._most:
            _, dropped = self._results.popitem(last=False)
            self._total -= self._size(dropped)
        return result
