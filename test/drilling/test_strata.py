"""Strata are checked, found by name, file or text, and their presets lie in published ranges."""

import dataclasses
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.rock import (
    ROCKS,
    Layer,
    Strata,
    StrataParameters,
    find_strata,
    inclusion_in,
    preset_layer,
)
from rpud_sim.foundation.quantities import ParameterError

EXAMPLE = Path(__file__).parents[2] / "config" / "strata_example.yaml"


def test_the_sandstone_is_that_of_the_paper_and_a_specific_energy_is_a_strength():
    assert ROCKS["sandstone"]["strength"] == 75e6
    assert list(ROCKS) == sorted(ROCKS, key=lambda name: ROCKS[name]["specific_energy"])
    equal = [name for name, rock in ROCKS.items() if rock["specific_energy"] == rock["strength"]]
    assert equal == ["chalk", "limestone", "sandstone", "basalt"]  # soil has no strength


@given(st.floats(1e6, 1e9), st.sampled_from([*ROCKS]))
def test_an_inclusion_is_nowhere_softer_than_its_layer_and_at_most_as_basalt(strength, rock):
    layer, basalt = preset_layer(rock, 0.01), preset_layer("basalt")
    stone = inclusion_in(layer, strength)
    for name in ("strength", "specific_energy", "threshold_energy"):
        expected = getattr(basalt, name) * strength / basalt.strength
        assert getattr(stone, name) == pytest.approx(max(expected, getattr(layer, name)))
    assert (stone.name, stone.depth_from) == (layer.name, layer.depth_from)


def test_strata_are_found_by_the_name_of_a_rock_and_by_path():
    assert find_strata("basalt") == Strata((preset_layer("basalt"),))
    strata = find_strata(str(EXAMPLE))
    assert [layer.name for layer in strata.layers] == ["regolith", "sandstone", "crust"]
    assert [strata.end_of(number) for number in range(3)] == [0.01, 0.03, math.inf]
    changed = strata.layers[1]
    assert changed == dataclasses.replace(
        preset_layer("sandstone"), depth_from=0.01, strength=60e6, specific_energy=60e6
    )
    assert StrataParameters().found is None


def test_the_content_of_a_file_takes_the_place_of_its_path(tmp_path):
    file = tmp_path / "strata.yaml"
    file.write_text("layers: [{depth_from: 0, rock: chalk, strength: 5.0e6}]\nbottom: 0.1")
    chosen = StrataParameters(str(file))
    file.unlink()
    assert StrataParameters(chosen.strata) == chosen
    assert StrataParameters(chosen.strata).found == chosen.found
    assert chosen.found.bottom == 0.1
    assert StrataParameters("chalk").strata == "chalk"


LAYERS = st.builds(
    Layer,
    name=st.text(max_size=20).filter(str.isprintable),
    specific_energy=st.floats(1e3, 1e12),
    strength=st.floats(1e2, 1e12),
    threshold_energy=st.floats(0.0, 1e3),
    abrasiveness=st.floats(0.0, 10.0),
    friction=st.floats(0.0, 2.0),
)


@given(st.lists(st.tuples(LAYERS, st.floats(1e-4, 1.0)), min_size=1, max_size=5), st.booleans())
def test_the_text_of_strata_gives_the_same_strata(drawn, ends):
    depth, layers = 0.0, []
    for layer, thickness in drawn:
        layers.append(dataclasses.replace(layer, depth_from=depth))
        depth += thickness
    strata = Strata(tuple(layers), depth if ends else math.inf)
    written = strata.to_text()
    assert "\n" not in written
    assert find_strata(written) == strata


CHALK = "\n- {depth_from: 0, rock: chalk"
LAYER_FAULTS = [
    ("{rock: basalt}", "depth_from is missing"),
    ("{depth_from: 0, rock: bassalt}", "rock = 'bassalt' is not a rock; did you mean basalt?"),
    ("{depth_from: 0, name: x, strength: 1.0e6}", "specific_energy is missing"),
    (
        '{depth_from: 0, rock: chalk, name: "a\\nb"}',
        r"name = 'a\nb' is not printable text of at most 60 letters",
    ),
]
FILE_FAULTS = [
    ("layers: []", "FILE:1: layers = [] has no layer; at least one is needed"),
    *((f"layers:\n- {text}", f"FILE:2: {said}") for text, said in LAYER_FAULTS),
    (
        "layers:\n- {depth_from: 0.01, rock: chalk}",
        "FILE:1: layer 1 (chalk): depth_from = 0.01 m is not 0 m, where the first layer begins",
    ),
    (
        f"layers:{CHALK}}}{CHALK}, name: x}}",
        "FILE:1: layer 2 (x): depth_from = 0 m is not below 0 m, where the one above begins",
    ),
    (f"layers:{CHALK}}}\nbottom: 0", "FILE:3: bottom = 0 m is outside its range (0, 10000] m"),
    (
        f"layers:{CHALK}}}\n- {{depth_from: 1, rock: chalk}}\nbottom: 0.5",
        "FILE:4: bottom = 0.5 m is not below 1 m, where the last layer begins",
    ),
]


@pytest.mark.parametrize(("written", "said"), FILE_FAULTS)
def test_a_file_that_cannot_be_used_says_why_in_one_line(tmp_path, written, said):
    file = tmp_path / "strata.yaml"
    file.write_text(written)
    with pytest.raises(ParameterError) as caught:
        find_strata(str(file))
    assert str(caught.value) == said.replace("FILE", str(file))


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ("bassalt", "strata = 'bassalt' is neither a file nor a rock; did you mean basalt?"),
        ("/nowhere.yaml", "/nowhere.yaml: No such file or directory"),
        ("a" * 5000, "strata = 'aaa"),
        ("{layers: 3}", "strata: layers = 3 is not a list"),
        ("{layers: [", "strata is not YAML: "),
    ],
)
def test_an_unknown_choice_says_why(choice, said):
    with pytest.raises(ParameterError) as caught:
        StrataParameters(choice)
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)
