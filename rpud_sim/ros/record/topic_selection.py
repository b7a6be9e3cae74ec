"""Selection of the topics to record."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass


@dataclass(frozen=True)
class TopicSelection:
    """Topics by name and by expression; without either, all of a namespace."""

    topics: Collection[str] = ()  # names
    # of topics to record, searched anywhere in the absolute name
    regex: re.Pattern[str] | None = None
    exclude: re.Pattern[str] | None = None  # of topics not to record, before all else
    everything: bool = False  # whether to record every namespace

    @property
    def closed(self) -> bool:
        """Whether it selects by name alone."""
        return bool(self.topics) and self.regex is None and not self.everything

    def wants(self, name: str, prefix: str) -> bool:
        """Return whether to record a topic; absolute names, ``prefix`` those of the namespace."""
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
