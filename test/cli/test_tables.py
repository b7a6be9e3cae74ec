"""A table is plain text, aligned as a terminal shows it."""

from rpud_sim.cli.tables import table


def test_a_table_is_aligned_after_escaping():
    assert table(("name", "n"), [("\x1b", 10)], left=1) == ["name   n", "\\x1b  10"]
