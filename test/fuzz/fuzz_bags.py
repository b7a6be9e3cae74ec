"""Fuzz the readers of bags, guided by coverage: BagError is the only error they may raise.

    pip install atheris
    python test/fuzz/fuzz_bags.py recover -max_total_time=300 -rss_limit_mb=1024 corpus/

Targets are `read`, `recover`, `metadata`, `losses` and `codec`. The first folder that is named
keeps what was found interesting, begun with small valid inputs. What it finds becomes a test in
one of test/bag/test_hostile_*.py. atheris is not among what `make` installs.
"""

import contextlib
import os
import shutil
import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["rpud_sim", "mcap", "rosbags"]):
    import rpud_sim.bag
    from rpud_sim.bag import BagError, Message, Topic, TopicSummary
    from rpud_sim.bag.cdr import Codec
    from rpud_sim.bag.losses import losses_from_record
    from rpud_sim.bag.metadata import load_offered_qos, metadata_from_document
    from rpud_sim.bag.recovery import recover
    from rpud_sim.bag.tables import Table

from mcap.writer import CompressionType, Writer

FOLDER = Path(tempfile.mkdtemp(dir="/dev/shm" if os.path.isdir("/dev/shm") else None))
DEFINITION = "uint8[] data\nstring[<=3] words\nE e\n" + "=" * 80 + "\nMSG: a_msgs/E\nint8 x\n"


def read(data: bytes) -> None:
    """Open a file and read everything in it."""
    file = FOLDER / "bag.mcap"
    file.write_bytes(data)
    with rpud_sim.bag.open(file) as bag:
        assert bag.compression
        assert bag.duration is not None
        for topic in bag.topics:
            assert topic.rate is None or topic.rate >= 0.0
        bag.records("notes")
        for _ in bag.messages():
            pass
        for _ in bag.batches():
            pass


def recover_file(data: bytes) -> None:
    """Recover a file; a recovered bag must be readable."""
    file = FOLDER / "torn.mcap"
    file.write_bytes(data)
    out = FOLDER / "out"
    shutil.rmtree(out, ignore_errors=True)
    recovery = recover(file, out)
    with rpud_sim.bag.open(out) as bag:
        assert sum(1 for _ in bag.messages()) == recovery.message_count
        assert len(bag.topics) == len({topic.topic.name for topic in bag.topics})


def metadata(data: bytes) -> None:
    """Read a metadata.yaml, and the offers of a channel."""
    text = data.decode("utf-8", "replace")
    with contextlib.suppress(BagError):
        load_offered_qos(text)
    metadata_from_document(text).to_document()


def losses(data: bytes) -> None:
    """Read the record of losses."""
    losses_from_record({"/a": data.decode("utf-8", "replace")})


def codec(data: bytes) -> None:
    """Compile a definition, decode a message by it, and make a table of it."""
    text, _, message = data.partition(b"\0\0")
    definition = text.decode("utf-8", "replace")
    Codec("a_msgs/msg/A", definition).decode(message)
    summary = TopicSummary(Topic("/a", "a_msgs/msg/A"), 1, 0, 0, definition, None)
    Table(summary).batch([Message("/a", 0, 0, message)])


def seeds(target: str) -> list[bytes]:
    """Return small valid inputs."""
    if target in ("read", "recover"):
        return [
            _file(kind, chunked, crc)
            for kind in CompressionType
            for chunked in (True, False)
            for crc in (True, False)
        ]
    if target == "metadata":
        from rpud_sim.bag import QosProfile
        from rpud_sim.bag.metadata import BagMetadata, FileInformation, dump_offered_qos

        topic = Topic("/a", "std_msgs/msg/String", "", (QosProfile(),))
        content = BagMetadata(1, 2, 3, ((topic, 3),), (FileInformation("a.mcap", 1, 2, 3),))
        return [content.to_document().encode(), dump_offered_qos((QosProfile(),)).encode()]
    if target == "losses":
        return [b'{"transport": 1, "queue": null}']
    message = b"\0\1\0\0\1\0\0\0\7\0\0\0\1\0\0\0\2\0\0\0a\0\0\0\5"
    return [DEFINITION.encode() + b"\0\0" + message]


def _file(compression: CompressionType, chunked: bool, crc: bool) -> bytes:
    file = FOLDER / "seed.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunked, enable_crcs=crc)
        writer.start("ros2", "fuzz")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/a", "cdr", schema, {"topic_type_hash": "x"})
        for number in range(4):
            writer.add_message(channel, number, b"\0\1\0\0\2\0\0\0a\0", number)
            if chunked and number == 1:
                writer.flush()
        writer.add_metadata("notes", {"a": "b"})
        writer.add_attachment(1, 2, "name", "type", b"data")
        writer.finish()
    return file.read_bytes()


TARGETS = {
    "read": read,
    "recover": recover_file,
    "metadata": metadata,
    "losses": losses,
    "codec": codec,
}


def main() -> None:
    """Fuzz the target in the first argument; libFuzzer gets the others."""
    name, *words = sys.argv[1:] or ["help"]
    if name not in TARGETS:
        sys.exit(__doc__)
    for word in words[:]:
        if not word.startswith("-"):
            folder = Path(word)
            folder.mkdir(parents=True, exist_ok=True)
            for number, content in enumerate(seeds(name)):
                (folder / f"seed{number}").write_bytes(content)

    def one(data: bytes) -> None:
        with contextlib.suppress(BagError):
            TARGETS[name](data)

    atheris.Setup([sys.argv[0], *words], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
