"""Bags that earlier versions wrote: this version computes every one of their messages again.

`offline_free` is a run without ROS before drilling, `run` a drill in real time from its start on,
and `stepped` one that was stepped, commanded, reconfigured and given faults, with a resonant
actuator and a rock model. `arm` was stepped on an arm, with strata and rotation, and reset.
"""

from pathlib import Path

import pytest

from rpud_sim.inspection.verify.recorded_journal import UnverifiableError
from rpud_sim.inspection.verify.verification import verify

BAGS = sorted((Path(__file__).parents[2] / "data").glob("*/*"))


def test_bags_of_every_earlier_version_are_there():
    names = [f"{bag.parent.name}/{bag.name}" for bag in BAGS]
    assert names == [
        *(f"0.1.0/{name}" for name in ("offline_free", "run", "stepped")),
        *(f"0.2.0/{name}" for name in ("arm", "offline_free", "run", "stepped")),
    ]


# Runs with a resonant actuator, whose physics was mended after 0.1.0.
MENDED = [bag for bag in BAGS if bag.parent.name == "0.1.0" and bag.name == "stepped"]


@pytest.mark.parametrize(
    "bag",
    [bag for bag in BAGS if bag not in MENDED],
    ids=lambda bag: f"{bag.parent.name}-{bag.name}",
)
def test_a_bag_of_an_earlier_version_is_proved_bit_for_bit(bag):
    verification = verify(bag)

    assert verification.first_difference is None
    assert sum(counts.equal for counts in verification.topics.values()) > 80
    assert not any(counts.missing for counts in verification.topics.values())


@pytest.mark.parametrize("bag", MENDED, ids=lambda bag: f"{bag.parent.name}-{bag.name}")
def test_a_bag_whose_physics_was_mended_is_not_called_false(bag):
    with pytest.raises(UnverifiableError, match="the physics was mended after version"):
        verify(bag)
