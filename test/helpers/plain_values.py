"""Plain values as YAML files hold them, hostile ones among them."""

from hypothesis import strategies as st


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
