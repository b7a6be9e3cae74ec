"""Hostile files end in one clear line, in bounded memory."""

import os
import struct

import lz4.frame
import pytest
import zstandard
from bounded_memory import read_in_bounded_memory
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Metadata, MetadataIndex, Statistics
from sample_bags import write_bag

import rpud_sim.bag
from rpud_sim.bag import BagError, BagFormatError
from rpud_sim.bag.limits import RECORD_LIMIT
from rpud_sim.bag.records import MAGIC
from rpud_sim.bag.recovery import recover


def mcap(*data, summary=(), chunk_indexes=()):
    """Return a file of these records, with an index for each chunk."""
    content = RecordBuilder()
    content.write(MAGIC + record(Opcode.HEADER, bytes(8)))
    indexes = list(chunk_indexes)
    for item in data:
        start = content.count
        if isinstance(item, bytes):
            content.write(item)
            continue
        item.write(content)
        if isinstance(item, Chunk):
            length = content.count - start
            size = item.uncompressed_size
            indexes.append(ChunkIndex(length, start, item.compression, 0, 9, 0, {}, 0, size))
    content.write(record(Opcode.DATA_END, bytes(4)))
    start = content.count
    for item in (Statistics(0, 0, {}, 1, 1, 9, 0, 0, 0), *summary, *indexes):
        item.write(content)
    Footer(start, 0, 0).write(content)
    content.write(MAGIC)
    return content.end()


def record(opcode, content):
    return struct.pack("<BQ", opcode, len(content)) + content


def chunk(compression, data, size, crc=0):
    return Chunk(compression, data, 9, 0, crc, size)


def zeros(size, head=b""):
    """Return compressed zeros, made block by block in little memory."""
    compressor = zstandard.ZstdCompressor(level=3).compressobj()
    parts = [compressor.compress(head + bytes(2**20 - len(head)))]
    parts += [compressor.compress(bytes(2**20)) for _ in range((size >> 20) - 1)]
    return b"".join([*parts, compressor.flush()])


def lz4_zeros(size):
    compressor = lz4.frame.LZ4FrameCompressor()
    parts = [compressor.begin()]
    parts += [compressor.compress(bytes(2**20)) for _ in range(size >> 20)]
    return b"".join([*parts, compressor.flush()])


GIGABYTE = 2**30
HUGE = 2**62
COMPLAINTS = {
    "zstd bomb that says so": "at most",
    "zstd bomb that lies": "a chunk has another size than it gives",
    "lz4 bomb that lies": "a chunk has another size than it gives",
    "chunk of petabytes": "at most",
    "record of petabytes": "do not end as they should",
    "string of gigabytes": "a length inside a record reaches beyond it",
    "one chunk without an end": "overlap each other",
    "chunks that all overlap in time": "overlap in time",
    "one record thousands of times": "0",  # messages: it is read, once
}


def bombs():
    """Return the hostile files by their names."""
    # A message that fills its chunk, so that each chunk stays open until it is taken.
    message = struct.pack("<BQHIQQ", Opcode.MESSAGE, RECORD_LIMIT - 9, 1, 0, 5, 5)
    full = chunk("zstd", zeros(RECORD_LIMIT, message), RECORD_LIMIT)
    bomb = zeros(GIGABYTE)
    string = record(Opcode.METADATA, b"\xf0\xff\xff\xff")
    notes = Metadata("notes", {"text": "x" * 10_000})
    metadata_index = MetadataIndex(25, 0, "notes")
    chunk_index = ChunkIndex(49, 25, "", 0, 9, 0, {}, 0, 0)
    return {
        "zstd bomb that says so": mcap(chunk("zstd", bomb, GIGABYTE)),
        "zstd bomb that lies": mcap(chunk("zstd", bomb, 1000)),
        "lz4 bomb that lies": mcap(chunk("lz4", lz4_zeros(GIGABYTE), 1000)),
        "chunk of petabytes": mcap(chunk("", b"abc", HUGE)),
        "record of petabytes": mcap(struct.pack("<BQ", Opcode.MESSAGE, HUGE) + bytes(100)),
        "string of gigabytes": mcap(string, summary=[metadata_index]),
        "one chunk without an end": mcap(chunk("", b"", 0), summary=[chunk_index] * 2_000),
        "chunks that all overlap in time": mcap(
            *[full] * 5, summary=[Channel(1, "/a", "cdr", {}, 0)]
        ),
        "one record thousands of times": mcap(notes, summary=[metadata_index] * 2_000),
    }


@pytest.fixture(scope="module")
def said_of_bombs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bombs")
    for name, content in bombs().items():
        (folder / name).write_bytes(content)
    return read_in_bounded_memory(folder)


@pytest.mark.extended
@pytest.mark.parametrize("name", COMPLAINTS)
def test_a_bomb_is_one_line_in_bounded_memory(name, said_of_bombs):
    read, recovered = said_of_bombs[name]
    assert COMPLAINTS[name] in read
    assert "\n" not in read
    assert len(read) < 500
    assert recovered == ("5" if "overlap" in name else "0")


def test_what_is_no_file_is_not_waited_for(tmp_path):
    path = write_bag(tmp_path / "run")
    (path / "run_0.mcap").unlink()
    os.mkfifo(path / "run_0.mcap")
    with pytest.raises(BagError, match=r"run_0\.mcap: is not a regular file"):
        rpud_sim.bag.open(path)
    with pytest.raises(BagError, match="there is no MCAP file"):
        recover(path, tmp_path / "out")


def test_a_summary_that_was_changed_is_found_by_its_checksum(tmp_path):
    file = write_bag(tmp_path / "run") / "run_0.mcap"
    content = file.read_bytes()
    place = content.rindex(b"/rpud/talk")
    file.write_bytes(content[:place] + b"/rpud/walk" + content[place + 10 :])
    with pytest.raises(BagFormatError, match="the checksum of its summary section is wrong"):
        rpud_sim.bag.open(file)
    assert recover(file, tmp_path / "out").topics["/rpud/talk"].recovered == 10
