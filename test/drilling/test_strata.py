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
    read_strata,
    uniform_strata,
)
from rpud_sim.foundation.quantities import ParameterError

EXAMPLE = Path(__file__).parents[2] / "config" / "strata_example.yaml"


def test_the_sandstone_is_that_of_the_paper_and_harder_rocks_follow():
    sandstone = preset_layer("sandstone")
    assert sandstone.strength == 75e6
    energies = [ROCKS[name]["specific_energy"] for name in ROCKS]
    assert list(ROCKS) == ["regolith", "chalk", "limestone", "sandstone", "basalt"]
    assert energies == sorted(energies)


def test_the_specific_energy_of_a_rock_is_its_strength():
    for name, rock in ROCKS.items():
        if name != "regolith":
            assert rock["specific_energy"] == rock["strength"]


@given(st.floats(1e6, 1e9), st.sampled_from([*ROCKS]))
def test_an_inclusion_is_nowhere_softer_than_its_layer(strength, rock):
    layer = preset_layer(rock, 0.01)
    stone = inclusion_in(layer, strength)
    assert stone.strength == max(strength, layer.strength)
    assert stone.specific_energy >= max(strength, layer.specific_energy)
    assert stone.threshold_energy >= layer.threshold_energy
    assert (stone.name, stone.depth_from) == (layer.name, layer.depth_from)


def test_an_inclusion_as_strong_as_basalt_is_as_hard_to_drill():
    stone, basalt = inclusion_in(preset_layer("chalk"), 2e8), preset_layer("basalt")
    for name in ("strength", "specific_energy", "threshold_energy"):
        assert getattr(stone, name) == pytest.approx(getattr(basalt, name))


def test_a_layer_ends_where_the_one_below_begins():
    strata = read_strata(EXAMPLE)
    assert [layer.name for layer in strata.layers] == ["regolith", "sandstone", "crust"]
    assert [strata.end_of(number) for number in range(3)] == [0.01, 0.03, math.inf]
    assert strata.layers[1].strength == 60e6
    assert strata.layers[1].abrasiveness == preset_layer("sandstone").abrasiveness


def test_strata_are_found_by_the_name_of_a_rock_by_path_and_by_text():
    assert find_strata("basalt") == Strata((preset_layer("basalt"),))
    example = find_strata(str(EXAMPLE))
    assert example == read_strata(EXAMPLE)
    assert StrataParameters(str(EXAMPLE)).found == example
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


@pytest.mark.parametrize("energy", [1e3, 75e6, 1e12])
def test_a_uniform_rock_is_as_strong_as_its_specific_energy(energy):
    (layer,) = uniform_strata(energy).layers
    assert (layer.specific_energy, layer.strength) == (energy, energy)
    assert (layer.threshold_energy, layer.abrasiveness) == (0.0, 0.0)


FULL = (
    "specific_energy: 1.0e6, strength: 1.0e6, threshold_energy: 0.0, abrasiveness: 1.0, "
    "friction: 0.5"
)


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("[]", "FILE is not a file of strata: it holds no mapping"),
        ("rocks: []", "FILE: line 1: 'rocks' is not one of layers, bottom"),
        ("layers: {}", "FILE: line 1: layers = {} is not a list"),
        ("layers: []", "FILE: layers = [] has no layer; at least one is needed"),
        ("layers:\n- 3", "FILE: line 2: layer 1: 3 is not a mapping"),
        (
            "layers:\n- {rock: basalt}",
            "FILE: line 2: layer 1: depth_from is missing; its range is [0, 10000] m",
        ),
        (
            "layers:\n- {depth_from: 0, rock: bassalt}",
            "FILE: line 2: layer 1: rock = 'bassalt' is unknown; did you mean basalt?",
        ),
        (
            "layers:\n- {depth_from: 0, rock: chalk}\n- {depth_from: 1, rock: chalk, strenght: 1}",
            "FILE: line 3: layer 2: strenght is unknown; did you mean strength?",
        ),
        (
            "layers:\n- {depth_from: 0, rock: chalk, strength: -1.0}",
            "FILE: line 2: layer 1: strength = -1 Pa is outside its range [100, 1e+12] Pa",
        ),
        (
            "layers:\n- {depth_from: 0, rock: chalk, strength: .nan}",
            "FILE: line 2: layer 1: strength = nan Pa is outside its range [100, 1e+12] Pa",
        ),
        (
            "layers:\n- {depth_from: 0, name: x, strength: 1.0e6}",
            "FILE: line 2: layer 1: specific_energy is missing, and so is a rock that would give "
            "it; its range is [1000, 1e+12] J/m^3",
        ),
        (
            f"layers:\n- {{depth_from: 0, {FULL}}}",
            "FILE: line 2: layer 1: name is missing, and so is a rock that would give it",
        ),
        (
            'layers:\n- {depth_from: 0, rock: chalk, name: "a\\nb"}',
            r"FILE: line 2: layer 1: name = 'a\nb' is not printable text of at most 60 letters",
        ),
        (
            "layers:\n- {depth_from: 0.01, rock: chalk}",
            "FILE: layer 1 (chalk): depth_from = 0.01 m is not 0 m, where the first layer begins",
        ),
        (
            "layers:\n- {depth_from: 0, rock: chalk}\n- {depth_from: 0, rock: basalt}",
            "FILE: layer 2 (basalt): depth_from = 0 m is not below 0 m, where the one above begins",
        ),
        (
            "layers: [{depth_from: 0, rock: chalk}]\nbottom: 0",
            "FILE: bottom = 0 m is outside its range (0, 10000] m",
        ),
        (
            "layers:\n- {depth_from: 0, rock: chalk}\n- {depth_from: 1, rock: chalk}\nbottom: 0.5",
            "FILE: bottom = 0.5 m is not below 1 m, where the last layer begins",
        ),
    ],
)
def test_a_file_that_cannot_be_used_says_why_in_one_line(tmp_path, written, said):
    file = tmp_path / "strata.yaml"
    file.write_text(written)
    with pytest.raises(ParameterError) as caught:
        read_strata(file)
    assert str(caught.value) == said.replace("FILE", str(file))


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ("bassalt", "strata = 'bassalt' is neither a file nor a rock; did you mean basalt?"),
        ("/nowhere.yaml", "/nowhere.yaml: No such file or directory"),
        ("{layers: 3}", "strata: layers = 3 is not a list"),
        ("{layers: [", "strata is not YAML: "),
    ],
)
def test_an_unknown_choice_says_why(choice, said):
    with pytest.raises(ParameterError) as caught:
        StrataParameters(choice)
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)
