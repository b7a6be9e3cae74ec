"""What a test said of the run in a bag, as a metadata record of the bag."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from rpud_sim.bag.errors import parsing

RECORD_NAME = "rpud_test"  # metadata record of a test's verdict

_KEY = "test"


@dataclass(frozen=True)
class RunVerdict:
    """Verdict of a test about the run in a bag."""

    test: str  # its name
    verdict: str  # ``passed``, ``failed`` or ``undecided``
    seed: str  # of all random numbers
    requirements: tuple[str, ...] = ()  # each with its verdict, value and time, in one line

    def to_record(self) -> dict[str, str]:
        """Return the content of the metadata record: one key with a JSON object."""
        return {_KEY: json.dumps(asdict(self), ensure_ascii=True)}


def tested_from_record(record: Mapping[str, str]) -> RunVerdict:
    """Return the verdict from the content of the metadata record."""
    with parsing(f"the record {RECORD_NAME}"):
        value = json.loads(record[_KEY])
        return RunVerdict(
            str(value["test"]),
            str(value["verdict"]),
            str(value["seed"]),
            tuple(str(line) for line in value["requirements"]),
        )
