"""A virtual environment becomes smaller, and every file that is used stays as it was."""

import os

from toolchain.slim import link_equal_files, remove_tests


def test_equal_files_become_one_and_others_stay(tmp_path):
    same, other = os.urandom(1 << 16), os.urandom(1 << 16)
    contents = {"lib.so": same, "lib.so.2": same, "deep/copy.so": same, "other.so": other}
    contents |= {"small": b"x", "small.copy": b"x"}
    (tmp_path / "deep").mkdir()
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "link").symlink_to("lib.so")
    for _ in range(2):  # again after another installation
        link_equal_files(tmp_path)
        assert {name: (tmp_path / name).read_bytes() for name in contents} == contents
        assert (tmp_path / "lib.so").stat().st_nlink == 3
        assert all((tmp_path / name).stat().st_nlink == 1 for name in ("other.so", "small"))
        found = {str(each.relative_to(tmp_path)) for each in tmp_path.rglob("*")}
        assert found == {*contents, "deep", "link"}


def test_only_the_tests_of_large_libraries_go(tmp_path):
    packages = tmp_path / "lib" / "python3.11" / "site-packages"
    kept = packages / "own" / "tests"
    for folder in (packages / "scipy" / "stats" / "tests" / "data", kept):
        folder.mkdir(parents=True)
        (folder / "file").touch()
    remove_tests(tmp_path)
    assert (kept / "file").exists()
    assert [*(packages / "scipy" / "stats").iterdir()] == []
