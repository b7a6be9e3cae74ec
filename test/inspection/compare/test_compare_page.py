"""The file of a comparison's page."""

import os

import pytest

from rpud_sim.inspection.compare import compare_page


def test_a_page_that_cannot_be_written_whole_is_not_there(tmp_path, monkeypatch):
    monkeypatch.setattr(compare_page, "render", lambda found: "half \ud800")
    with pytest.raises(UnicodeEncodeError):
        compare_page.write_page(None, tmp_path / "page.html")
    assert os.listdir(tmp_path) == []
