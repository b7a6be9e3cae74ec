"""Which topics are recorded."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass


@dataclass(frozen=True)
class TopicSelection:
    """Topics by name and by expression; without either, all of a namespace.

    `topics` are names. `regex` and `exclude` are searched for anywhere in the absolute name;
    `everything` stands for every namespace. Nothing that `exclude` fits is recorded.
    """

    topics: Collection[str] = ()
    regex: re.Pattern[str] | None = None
    exclude: re.Pattern[str] | None = None
    everything: bool = False

    @property
    def closed(self) -> bool:
        """Whether nothing but `topics` can be meant."""
        return bool(self.topics) and self.regex is None and not self.everything

    def wants(self, name: str, prefix: str) -> bool:
        """Tell whether to record the topic with that absolute name.

        `topics` must be absolute too; `prefix` begins the names of the namespace.
        """
        if self.exclude is not None and self.exclude.search(name):
            return False
        if name in self.topics:
            return True
        # Tokens that begin with an underscore are hidden, as those of actions and services are.
        if "/_" in name:
            return False
        if self.everything:
            return True
        if self.regex is not None:
            return self.regex.search(name) is not None
        return not self.topics and name.startswith(prefix)
