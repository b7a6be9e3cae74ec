"""What the page of a bag takes for a drill."""

import pytest
from watch.recorded.recorded_bags import FORCE, SECOND

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.watch.recorded.contents import drills
from rpud_sim.watch.recorded.recording import Recording

WRENCH = "geometry_msgs/msg/WrenchStamped"
HEADER = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "f"}
VECTOR = {"x": 0.0, "y": 0.0, "z": 1.0}
CONTENTS = {
    FORCE: {"header": HEADER, "force": 1.0},
    WRENCH: {"header": HEADER, "wrench": {"force": VECTOR, "torque": VECTOR}},
}


@pytest.mark.parametrize(
    ("topics", "expected"),
    [
        ({"/rpud/reacting_force": FORCE, "/arm/wrench": WRENCH}, ["/rpud"]),
        ({"/arm/wrench": WRENCH, "/leg/wrench": WRENCH}, ["/arm", "/leg"]),
    ],
)
def test_other_namespaces_are_offered_only_without_a_drill(tmp_path, topics, expected):
    with BagWriter(tmp_path / "bag") as bag:
        for name, kind in topics.items():
            definition = find_definition(kind)
            bag.add_topic(Topic(name, kind, find_type_hash(kind)), definition)
            bag.write(name, Codec(kind, definition).encode(CONTENTS[kind]), SECOND, SECOND)
    with Recording(tmp_path / "bag") as recording:
        assert drills(recording) == expected
