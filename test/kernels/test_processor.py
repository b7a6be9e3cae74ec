"""The target: the baseline where a processor has it, otherwise that processor alone."""

import pytest

from rpud_sim.kernels.store import (
    BASELINE,
    BASELINE_FEATURES,
    Target,
    choose_target,
)

ENOUGH = ",".join(f"+{name}" for name in sorted(BASELINE_FEATURES))


@pytest.mark.parametrize("more", ["", ",+avx512f,+fma4", ",-avx512f"])
def test_kernels_are_the_same_on_every_processor_with_the_baseline(more):
    assert choose_target("a processor", ENOUGH + more) == Target(BASELINE)


@pytest.mark.parametrize("missing", sorted(BASELINE_FEATURES))
def test_a_processor_without_one_instruction_has_kernels_of_its_own(missing):
    features = ENOUGH.replace(f"+{missing}", f"-{missing}", 1) + ",+fma4"
    target = choose_target("old", features)
    assert target.cpu == "old"
    assert target.features == features
    assert missing in target.lacking
