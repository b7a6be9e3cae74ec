"""Hostile documents and records end in one clear line, and lead nowhere else."""

import json
import os

import pytest
from bounded_memory import read_in_bounded_memory
from sample_bags import LAUGHS, rewrite, write_bag

import rpud_sim.bag
from rpud_sim.bag import BagFormatError
from rpud_sim.bag.limits import RECORD_LIMIT
from rpud_sim.bag.metadata import (
    load_offered_qos,
    losses_from_record,
    metadata_from_document,
)
from rpud_sim.bag.recovery import recover


@pytest.mark.parametrize(
    "text",
    [
        LAUGHS + "rosbag2_bagfile_information: {version: *k}\n",
        "rosbag2_bagfile_information: &a [*a]\n",
        "[" * 100_000,
        "{a: " * 100_000,
        "a: " + "1:" * 100_000 + "1\n",
        "a: " + "9" * 100_000 + "\n",
        "rosbag2_bagfile_information: !!python/object/apply:os.system [echo]\n",
        "a: 2001-99-99\n",
        "- x\n" * 30_000,
        "a: !!timestamp 1\n",
        "a: !!int x\n",
        "a: 1",
        "[",
        "{",
        "\x00",
        "3",
        "- {depth: [1]}",
        "rosbag2_bagfile_information: 3",
        "rosbag2_bagfile_information: {files: [3]}",
    ],
    ids=lambda text: text[:12],
)
def test_metadata_that_is_none_or_grows_is_refused(text):
    for load in (metadata_from_document, load_offered_qos):
        with pytest.raises(BagFormatError) as caught:
            load(text)
        assert len(str(caught.value)) < 1000
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["[", "{a: "])
def test_metadata_is_read_no_deeper_than_its_levels_are_allowed(text):
    with pytest.raises(BagFormatError, match="nested deeper than 100 levels"):
        metadata_from_document(text * 200 + "not read any more: [}")


def test_a_document_of_gigabytes_is_refused_unread(tmp_path):
    path = write_bag(tmp_path / "run")
    os.truncate(path / "metadata.yaml", 100 * RECORD_LIMIT)
    [[read, recovered]] = read_in_bounded_memory(tmp_path).values()
    assert f"has more than {RECORD_LIMIT} bytes" in read
    assert recovered == "10"  # the file itself is whole


@pytest.mark.parametrize(
    "name", ["../secret.mcap", "/etc/passwd", "a/../../secret.mcap", "..", "run_0.mcap/../.."]
)
def test_no_path_leads_out_of_the_bag(tmp_path, name):
    secret = write_bag(tmp_path / "other") / "other_0.mcap"
    secret.rename(tmp_path / "secret.mcap")
    path = write_bag(tmp_path / "run")
    rewrite(path / "metadata.yaml", "- run_0.mcap", f"- {name}")
    with pytest.raises(BagFormatError, match="is outside of the bag"):
        rpud_sim.bag.open(path)
    # Recovery takes what is in the folder, and nothing else.
    assert recover(path, tmp_path / "out").message_count == 10


@pytest.mark.parametrize("name", ["run_0.mcap", "./run_0.mcap", "run_0.mcap/."])
def test_a_file_named_twice_is_refused(tmp_path, name):
    path = write_bag(tmp_path / "run")
    rewrite(path / "metadata.yaml", "- run_0.mcap", f"- run_0.mcap\n  - {name}")
    with pytest.raises(BagFormatError, match="a file is named twice"):
        rpud_sim.bag.open(path)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "3",
        '{"transport": "x", "queue": 1}',
        "[" * 100_000,
        '{"transport": Infinity, "queue": 0}',
        '{"transport": NaN, "queue": 0}',
        '{"transport": 1, "queue": ' + "9" * 10_000 + "}",
        json.dumps({"transport": "x" * 10**6, "queue": 0}),
    ],
    ids=lambda text: text[:20],
)
def test_losses_that_are_none_are_refused(text):
    with pytest.raises(BagFormatError, match="rpud_losses") as caught:
        losses_from_record({"/a": text})
    assert len(str(caught.value)) < 1000
