"""Specifications of studies from plain values, for tests."""

from pathlib import Path

from rpud_sim.foundation.yaml_files import cursor_at
from rpud_sim.studies.fit import target_file
from rpud_sim.studies.sweep import specification_file


def parse_specification(content):
    """Return the sweep that plain values describe."""
    return specification_file.specification_of(cursor_at(content, "FILE"))


def parse_targets(content, folder=Path()):
    """Return the fit that plain values describe; the paths in it begin at a folder."""
    return target_file.specification_of(cursor_at(content, str(folder / "FILE")))
