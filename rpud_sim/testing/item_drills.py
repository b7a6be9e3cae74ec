"""Drills of pytest's items: each takes its own from the pool of the process, and gives it back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:  # pytest imports the plugin in every run, also where no test has a drill
    from rpud_sim.testing.drill import LockstepDrill
    from rpud_sim.testing.drill_pool import DrillPool
    from rpud_sim.testing.setup import DrillSetup

DRILLS = pytest.StashKey[list[Any]]()  # of an item
ATTEMPT = pytest.StashKey[Any]()  # of an item whose attempts are compared: its current one
POOL = pytest.StashKey["DrillPool"]()  # of a configuration


def pool_of(config: pytest.Config) -> DrillPool:
    """Return the pool of this process; its first drill's process loads while this one does."""
    if POOL not in config.stash:
        from rpud_sim.testing.drill_pool import DrillPool

        config.stash[POOL] = DrillPool()
    return config.stash[POOL]


def take_drill(item: pytest.Item, setup: DrillSetup, folder: Path) -> LockstepDrill:
    """Return a drill at time zero for a test, which leaves its artefacts."""
    from rpud_sim.testing.drill_pool import check_ros

    check_ros()
    drill = pool_of(item.config).take(setup, folder)
    item.stash.setdefault(DRILLS, []).append(drill)
    if ATTEMPT in item.stash:
        item.stash[ATTEMPT].take(drill)
    return drill


def give_back_drills(item: pytest.Item) -> None:
    """Keep the drills of a test for the next ones."""
    drills = item.stash.get(DRILLS, [])
    while drills:
        item.config.stash[POOL].give_back(drills.pop())
