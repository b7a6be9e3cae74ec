"""Folders of bags as rosbag2 and people leave them are read, or one line says what to do."""

import shutil
import warnings

import pytest
import zstandard
from sample_bags import START, STRING_DEFINITION, TALK, rewrite, serialized_string, write_bag

import rpud_sim.bag
from rpud_sim.bag import BagError, BagFormatError, BagNotFoundError, BagWriter
from rpud_sim.bag.recovery import recover
from rpud_sim.messages.errors import BagWarning


def replaced(old, new):
    return lambda path: rewrite(path / "metadata.yaml", old, new)


def beside_junk(path):
    (path / "metadata.yaml").unlink()
    (path / "._run_0.mcap").write_bytes(bytes(4096))


CHANGES = {
    "reindexed by Humble": replaced("storage_identifier: mcap", 'storage_identifier: ""'),
    "folder before the name": replaced("run_0.mcap", "run/run_0.mcap"),
    "another folder before the name": replaced("run_0.mcap", "/bags/old/run_0.mcap"),
    "of Windows": replaced("run_0.mcap", "C:\\bags\\run\\run_0.mcap"),
    "another storage in words": replaced("storage_identifier: mcap", "storage_identifier: MCAP"),
    "no storage": replaced("  storage_identifier: mcap\n", ""),
    "unpacked by hand": lambda path: (
        rewrite(path / "metadata.yaml", "run_0.mcap", "run_0.mcap.zstd"),
        rewrite(path / "metadata.yaml", "compression_mode: ''", "compression_mode: FILE"),
    ),
    "backslash": replaced("run_0.mcap", "run\\run_0.mcap"),
    "no files listed": replaced(
        "  relative_file_paths:\n  - run_0.mcap", "  relative_file_paths: []"
    ),
    "junk of macOS": beside_junk,
    "capital suffix": lambda path: (
        (path / "metadata.yaml").unlink() or (path / "run_0.mcap").rename(path / "RUN.MCAP")
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_folder_is_read_as_it_was_left(tmp_path, change):
    path = write_bag(tmp_path / "run")
    CHANGES[change](path)
    with rpud_sim.bag.open(path) as bag:
        assert len(list(bag.messages())) == 10
    recovery = recover(path, tmp_path / "out")
    assert (recovery.message_count, recovery.complete) == (10, True)


def test_the_metadata_stands_for_its_folder(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "run")
    monkeypatch.chdir(path)
    for place in (path / "metadata.yaml", "metadata.yaml"):
        with rpud_sim.bag.open(place) as bag:
            assert len(list(bag.messages())) == 10
    assert recover(path / "metadata.yaml", tmp_path / "out").message_count == 10


def test_a_renamed_file_is_read_with_a_warning(tmp_path):
    path = write_bag(tmp_path / "run")
    (path / "run_0.mcap").rename(path / "monday.mcap")
    said = r"lists run_0\.mcap, which does not exist; monday\.mcap is read instead"
    with pytest.warns(BagWarning, match=said), rpud_sim.bag.open(path) as bag:
        assert len(list(bag.messages())) == 10
    with pytest.warns(BagWarning, match=said):
        assert recover(path, tmp_path / "out").complete


def split_bag(path):
    with BagWriter(path, max_file_duration=2, compression="none") as bag:
        bag.add_topic(TALK, STRING_DEFINITION)
        for number in range(6):
            time = START + number * 1_000_000_000
            bag.write(TALK.name, serialized_string("x"), time, time)
    assert len(list(path.glob("*.mcap"))) == 3
    return path


def test_a_missing_file_is_named_and_lost(tmp_path):
    path = split_bag(tmp_path / "run")
    (path / "run_0.mcap").unlink()
    missing = "run_0.mcap, which metadata.yaml lists with 2 messages, is missing"
    with pytest.raises(BagNotFoundError, match=f"run: {missing}; rpud recover makes a bag of the"):
        rpud_sim.bag.open(path)
    recovery = recover(path, tmp_path / "out")
    assert (recovery.message_count, recovery.complete) == (4, False)
    assert recovery.damages == [f"lost: {missing}"]


def test_a_folder_around_a_bag_names_it(tmp_path):
    write_bag(tmp_path / "run")
    with pytest.raises(BagNotFoundError, match=r"nor an MCAP file; did you mean .*run\?"):
        rpud_sim.bag.open(tmp_path)


def test_a_folder_around_bags_names_them(tmp_path):
    for name in ("one", "two"):
        write_bag(tmp_path / name)
    with pytest.raises(BagNotFoundError, match=r"did you mean .*one or .*two\?"):
        rpud_sim.bag.open(tmp_path)


@pytest.mark.parametrize("listed", [True, False])
def test_a_copy_beside_a_file_is_read_once_with_a_warning(tmp_path, listed):
    path = write_bag(tmp_path / "run")
    shutil.copy(path / "run_0.mcap", path / "run_0 (copy).mcap")
    if not listed:
        (path / "metadata.yaml").unlink()
    said = "not read, for metadata.yaml does not list it" if listed else "has the same bytes as"
    with pytest.warns(BagWarning, match=said), rpud_sim.bag.open(path) as bag:
        assert len(list(bag.messages())) == 10
    with pytest.warns(BagWarning, match="has the same bytes as"):
        assert recover(path, tmp_path / "out").message_count == 10


def test_a_file_that_old_metadata_does_not_list_is_named(tmp_path):
    path = split_bag(tmp_path / "run")
    rewrite(path / "metadata.yaml", "  - run_2.mcap\n", "")
    with (
        pytest.warns(
            BagWarning, match=r"run_2\.mcap is not read, for metadata\.yaml does not list"
        ),
        rpud_sim.bag.open(path) as bag,
    ):
        assert len(list(bag.messages())) == 4
    assert recover(path, tmp_path / "out").message_count == 6


def test_a_number_that_files_lack_is_named_and_lost(tmp_path):
    path = split_bag(tmp_path / "run")
    for name in ("metadata.yaml", "run_1.mcap"):
        (path / name).unlink()
    said = r"run_1\.mcap, between the numbers of other files, is missing"
    with pytest.warns(BagWarning, match=said), rpud_sim.bag.open(path) as bag:
        assert len(list(bag.messages())) == 4
    assert not recover(path, tmp_path / "out").complete
    with warnings.catch_warnings():  # other names may have numbers for any reason
        warnings.simplefilter("error")
        for number in (0, 2):
            (path / f"run_{number}.mcap").rename(path / f"monday-{number}.mcap")
        rpud_sim.bag.open(path).close()


@pytest.mark.parametrize("names", ["run_0.mcap", "5", "{a: b}", "[null]", "[[run_0.mcap]]"])
def test_names_that_are_no_list_are_refused(tmp_path, names):
    path = write_bag(tmp_path / "run")
    old = "relative_file_paths:\n  - run_0.mcap"
    rewrite(path / "metadata.yaml", old, f"relative_file_paths: {names}")
    with pytest.raises(BagFormatError, match=r"must be a list of names; rpud recover"):
        rpud_sim.bag.open(path)
    assert recover(path, tmp_path / "out").message_count == 10


@pytest.mark.parametrize(
    ("content", "said"),
    [("", "is empty"), ("version https://git-lfs.github.com/spec/v1\n", "git lfs pull")],
)
def test_a_file_without_content_says_why(tmp_path, content, said):
    (tmp_path / "a.mcap").write_text(content)
    with pytest.raises(BagFormatError, match=said):
        rpud_sim.bag.open(tmp_path / "a.mcap")


def test_a_name_that_no_file_can_have_is_one_line(tmp_path):
    with pytest.raises(BagError, match="File name too long"):
        rpud_sim.bag.open(tmp_path / ("x" * 5000))


@pytest.mark.parametrize("text", ["", "x: 1", "rosbag2_bagfile_information: 3"])
def test_broken_metadata_names_what_makes_a_bag_without_it(tmp_path, text):
    path = write_bag(tmp_path / "run")
    (path / "metadata.yaml").write_text(text)
    with pytest.raises(BagFormatError, match=r"metadata\.yaml.*; rpud recover makes a whole bag"):
        rpud_sim.bag.open(path)
    assert recover(path, tmp_path / "out").message_count == 10


def test_what_is_no_bag_is_one_line(tmp_path):
    (tmp_path / "notes.mcap").write_text("some notes")
    with pytest.raises(BagError, match=r"notes\.mcap is not an MCAP file"):
        rpud_sim.bag.open(tmp_path / "notes.mcap")


def test_a_bag_with_some_files_compressed_names_what_unpacks_them(tmp_path):
    path = split_bag(tmp_path / "run")
    (path / "metadata.yaml").unlink()
    content = (path / "run_0.mcap").read_bytes()
    (path / "run_0.mcap").unlink()
    (path / "run_0.mcap.zstd").write_bytes(zstandard.compress(content))
    for read in (rpud_sim.bag.open, lambda place: recover(place, tmp_path / "out")):
        with pytest.raises(BagFormatError, match=r"unpack it first: zstd -d .*run_0\.mcap\.zstd"):
            read(path)
    (path / "run_0.mcap").write_bytes(content)
    with rpud_sim.bag.open(path) as bag:
        assert len(list(bag.messages())) == 6
