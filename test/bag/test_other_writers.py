"""MCAP bags of ``ros2 bag record`` are read; for others one line names what converts them."""

import pytest
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability
from rosbags.interfaces import QosTime as Span
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from sample_bags import START, STRING, STRING_DEFINITION, STRING_HASH, serialized_string

import rpud_sim.bag
from rpud_sim.bag import BagFormatError
from rpud_sim.bag.recovery import recover

FOREVER = Span(9223372036, 854775807)
OFFER = Qos(
    QosHistory.KEEP_LAST,
    7,
    QosReliability.BEST_EFFORT,
    QosDurability.TRANSIENT_LOCAL,
    FOREVER,
    Span(0, 5),
    QosLiveliness.AUTOMATIC,
    FOREVER,
    False,
)


def write(path, storage, mode):
    """Write messages on two topics with another library and return the path."""
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        talk, chat = (
            writer.add_connection(
                name,
                STRING,
                msgdef=STRING_DEFINITION,
                rihs01=STRING_HASH,
                offered_qos_profiles=offers,
            )
            for name, offers in (("/talk", [OFFER]), ("/chat", []))
        )
        for number in range(10):
            data = serialized_string(f"message {number}")
            writer.write(chat if number % 5 == 4 else talk, START + number, data)
    return path


@pytest.mark.parametrize(
    ("mode", "compression"), [(CompressionMode.NONE, "none"), (CompressionMode.STORAGE, "zstd")]
)
def test_mcap_is_read_with_its_offers_and_recovered(tmp_path, mode, compression):
    path = write(tmp_path / "run", StoragePlugin.MCAP, mode).rename(tmp_path / "a run 100%?#")
    with rpud_sim.bag.open(path) as bag:
        messages = list(bag.messages())
        assert [each.data for each in messages] == [
            serialized_string(f"message {number}") for number in range(10)
        ]
        assert [each.log_time for each in messages] == [START + number for number in range(10)]
        chat, talk = bag.topics
        assert (chat.message_count, chat.first_time, chat.last_time) == (2, START + 4, START + 9)
        assert (talk.topic.type, talk.definition) == (STRING, STRING_DEFINITION)
        [offer] = talk.topic.offered_qos
        assert (offer.depth, offer.reliability, offer.lifespan) == (7, "best_effort", 5)
        assert bag.compression == compression
    (path / "metadata.yaml").unlink()
    for place in (path, *path.iterdir()):
        with rpud_sim.bag.open(place) as bag:
            assert [*bag.messages()] == messages
    assert recover(path, tmp_path / "out").message_count == 10


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    ],
)
def test_other_storages_are_one_line_that_names_what_converts_them(tmp_path, storage, mode):
    path = write(tmp_path / "run", storage, mode)
    places = [path]
    if mode is not CompressionMode.MESSAGE:  # of which only the metadata says so
        places += path.glob("run*")
    for place in places:
        for read in (rpud_sim.bag.open, lambda place: recover(place, tmp_path / "out")):
            with pytest.raises(BagFormatError, match="ros2 bag convert -i BAG -o") as caught:
                read(place)
            assert "\n" not in str(caught.value)
            assert str(place) in str(caught.value)
    if len(places) > 1:
        (path / "metadata.yaml").unlink()
        with pytest.raises(BagFormatError, match="ros2 bag convert"):
            rpud_sim.bag.open(path)
    assert not (tmp_path / "out").exists()
