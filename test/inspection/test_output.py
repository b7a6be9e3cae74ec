"""A folder of results is complete or not there, and a failure is one line."""

import errno

import pytest

from rpud_sim.inspection.output import new_folder, output_reason


class RefusedError(Exception):
    pass


def test_a_folder_appears_when_it_is_complete(tmp_path):
    with new_folder(tmp_path / "out", RefusedError) as folder:
        (folder / "file").write_text("content")
        assert not (tmp_path / "out").exists()
    assert (tmp_path / "out" / "file").read_text() == "content"


def test_what_exists_is_kept_and_named(tmp_path):
    (tmp_path / "out").write_text("mine")
    reason = f"^{tmp_path / 'out'} exists already; nothing is overwritten$"
    with pytest.raises(RefusedError, match=reason), new_folder(tmp_path / "out", RefusedError):
        raise AssertionError("the folder was given")
    assert (tmp_path / "out").read_text() == "mine"


def run_out_of_space(out):
    with new_folder(out, RefusedError) as folder:
        (folder / "file").write_text("content")
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_failure_of_the_system_leaves_nothing_behind(tmp_path):
    reason = f"^cannot write {tmp_path / 'out'}: No space left on device$"
    with pytest.raises(RefusedError, match=reason):
        run_out_of_space(tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_other_errors_pass_unchanged(tmp_path):
    with pytest.raises(ZeroDivisionError), new_folder(tmp_path / "out", RefusedError):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_an_error_without_a_file_names_the_output():
    reason = output_reason("out.html", FileExistsError())
    assert reason == "out.html exists already; nothing is overwritten"
