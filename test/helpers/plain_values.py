"""Plain values as YAML files hold them: hostile ones, and the studies that they describe."""

from pathlib import Path

from hypothesis import strategies as st

from rpud_sim.foundation.yaml_files import cursor_at
from rpud_sim.studies.fit import target_file
from rpud_sim.studies.sweep import specification_file


def contents(keys, words):
    """Return strategies of keys, and of values that nest them; some are among those given."""
    scalars = st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(),
        st.text(max_size=5),
        st.sampled_from([*words]),
    )
    names = st.one_of(st.sampled_from([*keys]), scalars)
    nested = st.recursive(
        scalars,
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=4),
        max_leaves=12,
    )
    return names, nested


def parse_specification(content):
    """Return the sweep that plain values describe."""
    return specification_file.specification_of(cursor_at(content, "FILE"))


def parse_targets(content, folder=Path()):
    """Return the fit that plain values describe; the paths in it begin at a folder."""
    return target_file.specification_of(cursor_at(content, str(folder / "FILE")))
