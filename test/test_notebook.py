"""The notebook of the examples prints what it shows."""

import json
from importlib import import_module
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[1] / "examples" / "first_look.ipynb"


def shown(notebook):
    """Return the texts that cells print, and which of them show pictures."""
    return [
        (
            output.get("text"),
            sorted(output.get("data", ())),
            output.get("data", {}).get("text/plain"),
        )
        for cell in notebook["cells"]
        for output in cell.get("outputs", ())
    ]


@pytest.mark.extended
def test_the_notebook_shows_what_its_cells_give():
    """The bits of a run are the same everywhere, and so are its digits; pictures may differ."""
    executed = import_module("toolchain.notebook").executed
    kept = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert len(shown(kept)) > 8
    assert shown(executed(kept)) == shown(kept), "python -m toolchain.notebook examples/*.ipynb"
