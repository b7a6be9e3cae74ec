"""Files of overrides are those that rosbag2 takes, and a mistake in one is named."""

import pytest
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from rpud_sim.ros.qos import RECORDING_DEPTH
from rpud_sim.ros.record.qos_overrides import QosOverrideError, read_qos_overrides


@pytest.fixture
def file(tmp_path):
    def write(text):
        (tmp_path / "qos.yaml").write_text(text)
        return str(tmp_path / "qos.yaml")

    return write


def test_every_policy_can_be_named(file):
    profiles = read_qos_overrides(
        file(
            "/a:\n"
            "  history: keep_last\n"
            "  depth: 7\n"
            "  reliability: best_effort\n"
            "  durability: transient_local\n"
            "  deadline: {sec: 1, nsec: 5}\n"
            "  lifespan: {sec: 0, nsec: 0}\n"
            "  liveliness: automatic\n"
            "  liveliness_lease_duration: {sec: 2, nsec: 0}\n"
            "  avoid_ros_namespace_conventions: false\n"
            "/b: {reliability: reliable}\n"
        )
    )
    first, second = profiles["/a"], profiles["/b"]
    assert (first.history, first.depth) == (HistoryPolicy.KEEP_LAST, 7)
    assert first.reliability == ReliabilityPolicy.BEST_EFFORT
    assert first.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert first.deadline == Duration(seconds=1, nanoseconds=5)
    assert (second.reliability, second.depth) == (ReliabilityPolicy.RELIABLE, RECORDING_DEPTH)


def test_an_empty_file_overrides_nothing(file):
    assert read_qos_overrides(file("")) == {}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[1, 2]", "must name topics"),
        ("/a: 3", "/a must have policies"),
        ("a: {depth: 1}", "a must be an absolute name, such as /a"),
        ("/a: {width: 1}", "/a has 'width'; policies are history, depth"),
        ("/a: {1: 1}", "/a has 1; policies are"),
        ("/a: {depth: -1}", "/a: depth is -1; it must be a whole number from 0"),
        ("/a: {depth: true}", "/a: depth is True"),
        ("/a: {reliability: some}", "/a: reliability is 'some'; it must be one of .*best_effort"),
        ("/a: {deadline: {sec: -1, nsec: 0}}", "/a: deadline is .*; it must be sec from 0"),
        ("/a: {deadline: {sec: 1}}", "/a: deadline is .*; it must be sec from 0"),
        ("/a: {deadline: 1}", "/a: deadline is 1; it must be sec"),
        ("/a: {avoid_ros_namespace_conventions: 1}", "it must be true or false"),
        ("/a: [", "is not YAML"),
    ],
)
def test_what_cannot_be_used_is_named(file, text, complaint):
    with pytest.raises(QosOverrideError, match=complaint):
        read_qos_overrides(file(text))


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(QosOverrideError, match=r"cannot read .*none.yaml: No such file"):
        read_qos_overrides(str(tmp_path / "none.yaml"))
