"""Hostile files end in one clear line, in bounded memory."""

import io
import json
import os
import struct
import subprocess
import sys
import zlib

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Metadata, MetadataIndex, Statistics
from sample_bags import START, write_bag

import rpud_sim.bag
from rpud_sim.bag import BagError, BagFormatError
from rpud_sim.bag.budget import DECODED_LIMIT
from rpud_sim.bag.cdr import DEFINITION_LIMIT, Codec
from rpud_sim.bag.errors import DefinitionNotFoundError
from rpud_sim.bag.losses import losses_from_record
from rpud_sim.bag.metadata import SIZE_LIMIT, load_offered_qos, metadata_from_document
from rpud_sim.bag.records import CONTENT_LIMIT, MAGIC
from rpud_sim.bag.recovery import recover

MEMORY = 768 * 2**20  # of address space, that a process may have to read any file

READ_ALL = f"""
import json, pathlib, resource, sys
from rpud_sim.bag import BagError, open
from rpud_sim.bag.recovery import recover
resource.setrlimit(resource.RLIMIT_AS, ({MEMORY}, {MEMORY}))
def read(path):
    with open(path) as bag:
        bag.topics, bag.records("notes")
        return sum(1 for _ in bag.messages())
def recovered(path):
    return recover(path, path.parent / "recovered" / path.name).message_count
def said(task, path):
    try:
        return str(task(path))
    except BagError as error:
        return str(error)
for path in sorted(pathlib.Path(sys.argv[1]).iterdir()):
    print(json.dumps([path.name, said(read, path), said(recovered, path)]), flush=True)
"""


def read_in_bounded_memory(folder):
    """Read and recover the bags of a folder in a process with little memory; return its output."""
    result = subprocess.run(
        [sys.executable, "-c", READ_ALL, folder],
        capture_output=True,
        text=True,
        timeout=100.0,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr[-2000:]
    return {name: said for name, *said in map(json.loads, result.stdout.splitlines())}


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
    "zstd bomb that lies": "damaged",
    "zstd frame of petabytes": "not as large as it says",
    "lz4 bomb that lies": "not as large as it says",
    "chunk of petabytes": "at most",
    "record of petabytes": "reaches beyond its place",
    "channel of gigabytes": "reaches beyond its place",
    "string of gigabytes": "a length inside a record reaches beyond it",
    "one chunk without an end": "overlap each other",
    "chunks that all overlap in time": "overlap in time",
    "one record thousands of times": "0",  # messages: it is read, once
}


def bombs():
    """Return the hostile files by their names."""
    # A message that fills its chunk, so that each chunk stays open until it is taken.
    message = struct.pack("<BQHIQQ", Opcode.MESSAGE, CONTENT_LIMIT - 9, 1, 0, 5, 5)
    full = chunk("zstd", zeros(CONTENT_LIMIT, message), CONTENT_LIMIT)
    frame = b"\x28\xb5\x2f\xfd\xe0" + HUGE.to_bytes(8, "little")
    bomb = zeros(GIGABYTE)
    string = record(Opcode.METADATA, b"\xf0\xff\xff\xff")
    notes = Metadata("notes", {"text": "x" * 10_000})
    metadata_index = MetadataIndex(25, 0, "notes")
    chunk_index = ChunkIndex(49, 25, "", 0, 9, 0, {}, 0, 0)
    return {
        "zstd bomb that says so": mcap(chunk("zstd", bomb, GIGABYTE)),
        "zstd bomb that lies": mcap(chunk("zstd", bomb, 1000)),
        "zstd frame of petabytes": mcap(chunk("zstd", frame, 1000)),
        "lz4 bomb that lies": mcap(chunk("lz4", lz4_zeros(GIGABYTE), 1000)),
        "chunk of petabytes": mcap(chunk("", b"abc", HUGE)),
        "record of petabytes": mcap(struct.pack("<BQ", Opcode.MESSAGE, HUGE) + bytes(100)),
        "channel of gigabytes": mcap(struct.pack("<BQ", Opcode.CHANNEL, 2**31) + bytes(1000)),
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


@pytest.mark.parametrize("name", COMPLAINTS)
def test_a_bomb_is_one_line_in_bounded_memory(name, said_of_bombs):
    read, recovered = said_of_bombs[name]
    assert COMPLAINTS[name] in read
    assert "\n" not in read
    assert len(read) < 500
    assert recovered == ("5" if "overlap" in name else "0")


def test_the_bombs_are_files_that_another_reader_takes_for_bags():
    content = mcap(chunk("zstd", zeros(2**20), 1000))
    [index] = make_reader(io.BytesIO(content)).get_summary().chunk_indexes
    assert content[index.chunk_start_offset] == Opcode.CHUNK


def test_a_chunk_within_the_limit_is_read(tmp_path):
    message = struct.pack("<HIQQ", 1, 0, 5, 5) + bytes(10_000_000)
    data = record(Opcode.MESSAGE, message)
    path = tmp_path / "large.mcap"
    path.write_bytes(mcap(chunk("zstd", zstandard.compress(data), len(data), zlib.crc32(data))))
    with rpud_sim.bag.open(path) as bag:
        assert list(bag.messages()) == []  # it has no such channel, and says so by silence


LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n"
    for before, name in zip("abcdefghij", "bcdefghijk", strict=True)
)


@pytest.mark.parametrize(
    "text",
    [
        LAUGHS + "rosbag2_bagfile_information: {version: *k}\n",
        "rosbag2_bagfile_information: &a [*a]\n",
        "[" * 100_000,
        "{a: " * 100_000,
        "a: " + "1:" * 100_000 + "1\n",
        "a: " + "9" * 100_000 + "\n",
        "- x\n" * 300_000,
        "rosbag2_bagfile_information: !!python/object/apply:os.system [echo]\n",
        "a: 2001-99-99\n",
        "a: !!timestamp 1\n",
        "? [a]\n: b\n",
        "a: !!int x\n",
        "a: .inf\n",
    ],
    ids=lambda text: text[:12],
)
def test_metadata_that_grows_is_refused(text):
    for load in (metadata_from_document, load_offered_qos):
        with pytest.raises(BagFormatError) as caught:
            load(text)
        assert len(str(caught.value)) < 1000
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [".inf", ".nan", "[1]", "{a: b}", "1e400", "null"])
def test_numbers_that_are_none_are_refused(tmp_path, value):
    path = write_bag(tmp_path / "run")
    document = path / "metadata.yaml"
    text = document.read_text()
    for name in ("version: 9", "message_count: 10", "nanoseconds: 9000000"):
        assert name in text
        document.write_text(text.replace(name, f"{name.split(':')[0]}: {value}"))
        with pytest.raises(BagFormatError, match=r"metadata\.yaml"):
            rpud_sim.bag.open(path)


def test_aliases_that_stay_small_are_read(tmp_path):
    text = (write_bag(tmp_path / "run") / "metadata.yaml").read_text()
    text = text.replace("custom_data: {}", "custom_data: {first: &a one, second: *a}")
    assert metadata_from_document(text).custom_data == {"first": "one", "second": "one"}


def test_a_document_of_gigabytes_is_refused_unread(tmp_path):
    path = write_bag(tmp_path / "run")
    os.truncate(path / "metadata.yaml", 100 * SIZE_LIMIT)
    [[read, recovered]] = read_in_bounded_memory(tmp_path).values()
    assert f"has more than {SIZE_LIMIT} bytes" in read
    assert recovered == "10"  # the file itself is whole


@pytest.mark.parametrize(
    "name", ["../secret.mcap", "/etc/passwd", "a/../../secret.mcap", "..", "run_0.mcap/../.."]
)
def test_no_path_leads_out_of_the_bag(tmp_path, name):
    secret = write_bag(tmp_path / "other") / "other_0.mcap"
    secret.rename(tmp_path / "secret.mcap")
    path = write_bag(tmp_path / "run")
    document = path / "metadata.yaml"
    document.write_text(document.read_text().replace("- run_0.mcap", f"- {name}"))
    with pytest.raises(BagFormatError, match="is outside of the bag"):
        rpud_sim.bag.open(path)
    # Recovery takes what is in the folder, and nothing else.
    assert recover(path, tmp_path / "out").message_count == 10


@pytest.mark.parametrize("name", ["run_0.mcap", "./run_0.mcap", "run_0.mcap/."])
def test_a_file_named_twice_is_refused(tmp_path, name):
    path = write_bag(tmp_path / "run")
    document = path / "metadata.yaml"
    text = document.read_text().replace("- run_0.mcap", f"- run_0.mcap\n  - {name}")
    document.write_text(text)
    with pytest.raises(BagFormatError, match="a file is named twice"):
        rpud_sim.bag.open(path)


def test_what_is_no_file_is_not_waited_for(tmp_path):
    path = write_bag(tmp_path / "run")
    (path / "run_0.mcap").unlink()
    os.mkfifo(path / "run_0.mcap")
    with pytest.raises(BagFormatError, match=r"run_0\.mcap is not a file"):
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


@pytest.mark.parametrize(
    "text",
    [
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


SEPARATOR = "=" * 80


@pytest.mark.parametrize(
    "definition",
    [
        "A x\n",
        "A[] x\n",
        "string[4294967295] x\n",
        "string[100] x\n" * 200,
        f"B[4294967295] x\n{SEPARATOR}\nMSG: a_msgs/B\nint8 x\n",
        "Unknown x\n",
        "\x00\x01 x\n",
        "int8 x\n" * 100,
        "# " + "x" * DEFINITION_LIMIT,
    ],
    ids=lambda text: text[:20],
)
def test_a_wrong_schema_is_one_line(definition):
    with pytest.raises(BagFormatError) as caught:
        Codec("a_msgs/msg/A", definition)
    assert len(str(caught.value)) < 500
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("definition", "data"),
    [
        ("float64 x\n", b""),
        ("float64 x\n", b"\0\1\0\0"),
        ("float64[] x\n", b"\0\1\0\0\xff\xff\xff\x7f"),
        ("string x\n", b"\0\1\0\0\xff\xff\xff\x7f"),
        ("string[] x\n", b"\0\1\0\0\xff\xff\xff\x7f"),
        (f"B[] x\n{SEPARATOR}\nMSG: a_msgs/B\nint8 X=1\n", b"\0\1\0\0\xff\xff\xff\x7f"),
        ("float64[4294967295] x\n", b"\0\1\0\0"),
        ("float64[99999999999999999999] x\n", b"\0\1\0\0"),
        ("string x\n", b"\0\1\0\0\2\0\0\0\xff\0"),
    ],
)
def test_a_message_that_is_not_of_its_type_is_one_line(definition, data):
    with pytest.raises(BagFormatError, match="a message of a_msgs/msg/A cannot be understood"):
        Codec("a_msgs/msg/A", definition).decode(data)


@pytest.mark.parametrize("name", ["../../etc/passwd", "a/../b", "/etc/x", "a\n/b", "a/msg/../b"])
def test_a_type_s_name_is_no_path(name, tmp_path):
    from rpud_sim.bag.definitions import find_definition

    with pytest.raises(DefinitionNotFoundError, match="it must be of the form"):
        find_definition(name, [tmp_path])


def test_hostile_times_do_not_disturb_recovery(tmp_path):
    path = write_bag(tmp_path / "run") / "run_0.mcap"
    with rpud_sim.bag.open(path) as bag:
        assert bag.start_time == START
    footer = struct.pack("<BQ", Opcode.FOOTER, 20) + bytes(20) + MAGIC
    path.write_bytes(path.read_bytes()[: -len(footer)] + footer)
    with pytest.raises(BagFormatError, match="no summary section"):
        rpud_sim.bag.open(path)
    assert recover(path, tmp_path / "out").complete


def test_statistics_that_contradict_the_indexes_give_no_negative_rate(tmp_path):
    message = record(Opcode.MESSAGE, struct.pack("<HIQQ", 1, 0, 5, 5))
    times = struct.pack("<QQQQ", 5, 0, 9, 0)
    index = record(Opcode.MESSAGE_INDEX, struct.pack("<HI", 1, 32) + times)
    place = len(MAGIC) + 9 + 8
    path = tmp_path / "liar.mcap"
    path.write_bytes(
        mcap(
            index,
            message,
            summary=[Channel(1, "/a", "cdr", {}, 0)],
            chunk_indexes=[ChunkIndex(0, 0, "", 0, 9, 0, {1: place}, 0, 0)],
        )
    )
    with rpud_sim.bag.open(path) as bag:
        [topic] = bag.topics
    assert (topic.first_time, topic.last_time, topic.message_count) == (5, 9, 0)
    assert topic.rate is None


CUT = """
import pathlib, resource, sys
from rpud_sim.bag.recovery import recover
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
content, head = pathlib.Path(sys.argv[1]).read_bytes(), int(sys.argv[2])
for whole in (content, content[head:]):
    start = head if whole is content else 0
    for size in range(start, min(start + 80, len(whole))):
        torn = pathlib.Path(sys.argv[1]).with_name("torn.mcap")
        torn.write_bytes(whole[:size])
        try:
            count = recover(torn, torn.with_name(f"{start}-{size}")).message_count
            print(size - start, count, flush=True)
        except Exception as error:
            print(size - start, type(error).__name__, flush=True)
"""


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_a_cut_at_any_byte_of_a_chunk_s_head_ends(tmp_path, compression):
    content = (write_bag(tmp_path / "run", compression=compression) / "run_0.mcap").read_bytes()
    [index] = make_reader(io.BytesIO(content)).get_summary().chunk_indexes
    (tmp_path / "whole.mcap").write_bytes(content)
    command = [sys.executable, "-c", CUT, tmp_path / "whole.mcap", str(index.chunk_start_offset)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=200.0, check=False)
    assert result.returncode == 0, result.stdout[-200:] + result.stderr[-2000:]
    rows = [line.split() for line in result.stdout.splitlines()]
    assert len(rows) == 160
    assert {result for _, result in rows[:80]} <= {"0", "1"}  # nothing before is lost
    assert {result for _, result in rows[80:]} <= {"0", "1", "BagFormatError"}


def nest(depth, leaf):
    """Return the definition of a type in which each member has two of the next."""
    parts = ["N1 first\nN1 second\n"]
    for level in range(1, depth):
        fields = leaf if level == depth - 1 else f"N{level + 1} first\nN{level + 1} second\n"
        parts.append(f"{SEPARATOR}\nMSG: a_msgs/N{level}\n{fields}")
    return "".join(parts)


@pytest.mark.parametrize("leaf", ["int8 X=1\n", "int8 x\n", "int8[] x\n"])
def test_a_type_of_countless_members_is_refused_unvisited(leaf):
    with pytest.raises(BagFormatError, match="fields with those of its members; at most 100000"):
        Codec("a_msgs/msg/N0", nest(31, leaf))
    assert Codec("a_msgs/msg/N0", nest(5, leaf)).fields("a_msgs/msg/N0")


def test_arrays_of_arrays_multiply():
    parts = [f"{SEPARATOR}\nMSG: a_msgs/{name}\n" for name in "BCD"]
    definition = f"B[99] b\n{parts[0]}C[99] c\n{parts[1]}D[99] d\n{parts[2]}int8 x\n"
    with pytest.raises(BagFormatError, match="fields with those of its members; at most 100000"):
        Codec("a_msgs/msg/A", definition)


def test_a_definition_that_takes_long_to_compile_is_refused():
    fields = "".join(f"int8 x{number}\n" for number in range(8000))
    with pytest.raises(BagFormatError, match="more than 65536 characters without its comments"):
        Codec("a_msgs/msg/A", fields)
    assert Codec("a_msgs/msg/A", "int8 x # " + "long " * 20_000).fields("a_msgs/msg/A")


TINY = f"B[] parts\n{SEPARATOR}\nMSG: a_msgs/B\nint8 x\n"
GREEDY = {  # a definition, and the first bytes of a message that ends in zeros
    "tiny members": (TINY, struct.pack("<I", 60_000_000)),
    "no members": (TINY.replace("int8 x", "int8 X=1"), struct.pack("<I", 60_000_000)),
    "texts": ("string[] texts\n", struct.pack("<I", 12_000_000) + struct.pack("<IB3x", 1, 0) * 9),
    "lists": (TINY.replace("int8 x", "int8[] x"), struct.pack("<I", 15_000_000)),
    "members' members": (
        f"C[] more\n{SEPARATOR}\nMSG: a_msgs/C\n{TINY}",
        struct.pack("<II", 1, 60_000_000),
    ),
    "numbers": ("uint8[] numbers\n", struct.pack("<I", 60_000_000)),
    "text": ("string text\n", struct.pack("<I", 60_000_000)),
}

EXPORT = """
import json, pathlib, resource, sys
from rpud_sim.inspection.export.export import export
from rpud_sim.bag import BagError
resource.setrlimit(resource.RLIMIT_CPU, (10, 10))
path = pathlib.Path(sys.argv[1])
try:
    said = str(export(path, path.with_suffix(".out"), sys.argv[2]))
except BagError as error:
    said = str(error)
print(json.dumps([said, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024]))
"""


def greedy_bag(path, definition, head, size):
    """Write a bag of a few kB with one message of ``size`` bytes and return its path."""
    message = b"\0\1\0\0" + head
    message += bytes(size - len(message))
    with rpud_sim.bag.BagWriter(path) as bag:
        bag.add_topic(rpud_sim.bag.Topic("/a", "a_msgs/msg/A"), definition)
        bag.write("/a", message, START, START)
    return path


def exported(path, file_format):
    """Export a bag in another process; return its output and its memory [bytes]."""
    result = subprocess.run(
        [sys.executable, "-c", EXPORT, path, file_format],
        capture_output=True,
        text=True,
        timeout=100.0,
        check=False,
    )
    assert result.returncode == 0, result.stderr[-2000:]
    return json.loads(result.stdout)


@pytest.mark.parametrize("name", GREEDY)
def test_a_message_that_grows_when_it_is_decoded_is_refused(tmp_path, name):
    path = greedy_bag(tmp_path / "run", *GREEDY[name], 64_000_000)
    assert sum(file.stat().st_size for file in path.iterdir()) < 20_000
    said, memory = exported(path, "csv")
    assert "at most 268435456 are read" in said
    assert memory < GIGABYTE


@pytest.mark.parametrize("file_format", ["parquet", "csv", "numpy"])
@pytest.mark.parametrize("name", ["tiny members", "numbers", "text"])
def test_a_message_just_within_the_limit_stays_in_memory(tmp_path, name, file_format):
    count = {"tiny members": 440_000, "numbers": 26_000_000, "text": 44_000_000}[name]
    definition, _ = GREEDY[name]
    path = greedy_bag(tmp_path / "run", definition, struct.pack("<I", count), count + 9)
    said, memory = exported(path, file_format)
    assert "messages=1" in said
    assert memory < GIGABYTE


def test_the_budget_counts_what_is_there_and_not_what_could_be():
    definition = f"uint8[] image\nstring[] names\n{TINY}"
    image = bytes(25_000_000)
    message = b"\0\1\0\0" + struct.pack("<I", len(image)) + image + struct.pack("<II", 0, 1)
    codec = Codec("a_msgs/msg/A", definition)
    assert codec.decoded_sizes(np.array([len(message)]))[0] > 10 * DECODED_LIMIT
    decoded = codec.decode(message + b"\7")
    assert (len(decoded.image), len(decoded.parts)) == (len(image), 1)
