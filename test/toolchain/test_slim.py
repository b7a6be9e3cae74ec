"""A virtual environment becomes smaller, and every file that is used stays as it was."""

import os

import pytest

from toolchain.slim import link_equal_files, remove_tests


def test_equal_files_become_one_and_others_stay(tmp_path):
    same, other = os.urandom(1 << 16), os.urandom(1 << 16)
    contents = {"lib.so": same, "lib.so.2": same, "deep/copy.so": same, "other.so": other}
    contents |= {"small": b"x", "small.copy": b"x"}
    libraries = tmp_path / "lib"
    (libraries / "deep").mkdir(parents=True)
    for name, content in contents.items():
        (libraries / name).write_bytes(content)
    (libraries / "link").symlink_to("lib.so")
    for _ in range(2):  # again after another installation
        link_equal_files(tmp_path)
        assert {name: (libraries / name).read_bytes() for name in contents} == contents
        assert (libraries / "lib.so").stat().st_nlink == 3
        assert all((libraries / name).stat().st_nlink == 1 for name in ("other.so", "small"))
        found = {str(each.relative_to(libraries)) for each in libraries.rglob("*")}
        assert found == {*contents, "deep", "link"}


@pytest.mark.parametrize("place", ["lib/library/__pycache__", "typescript"])
def test_what_another_process_writes_meanwhile_is_not_looked_at(tmp_path, place):
    (tmp_path / place).mkdir(parents=True)
    files = [tmp_path / place / name for name in ("one", "two")]
    for file in files:
        file.write_bytes(bytes(1 << 16))
    link_equal_files(tmp_path)
    assert [file.stat().st_nlink for file in files] == [1, 1]


def test_only_the_tests_of_large_libraries_go(tmp_path):
    packages = tmp_path / "lib" / "python3.11" / "site-packages"
    kept = packages / "own" / "tests"
    for folder in (packages / "scipy" / "stats" / "tests" / "data", kept):
        folder.mkdir(parents=True)
        (folder / "file").touch()
    remove_tests(tmp_path)
    assert (kept / "file").exists()
    assert [*(packages / "scipy" / "stats").iterdir()] == []
