"""Which sockets a drill, a recorder, a replayer and a client open, and what they offer there."""

import os
import re
import socket
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory
from rpud_msgs.msg import WeightOnBit
from support import LOOPBACK

pytestmark = pytest.mark.extended

POLICY = Path(get_package_share_directory("rpud_sim"), "config", "sros2_policy.xml")
RULES = {  # what a node does in the graph, and where the policy allows that
    "publisher": ("topics", "publish"),
    "subscriber": ("topics", "subscribe"),
    "service": ("services", "reply"),
    "client": ("services", "request"),
}

loopback_alone = pytest.mark.skipif(
    LOOPBACK["ROS_AUTOMATIC_DISCOVERY_RANGE"] != "SYSTEM_DEFAULT",
    reason="the profile is of Fast DDS",
)


def sockets(pid):
    """Give the local addresses of the UDP and TCP sockets that a process has open."""
    links = (entry.readlink() for entry in Path(f"/proc/{pid}/fd").iterdir() if entry.is_symlink())
    own = {match[1] for link in links if (match := re.match(r"socket:\[(\d+)\]", str(link)))}
    return sorted(
        address
        for protocol in ("udp", "udp6", "tcp", "tcp6")
        for line in Path(f"/proc/{pid}/net/{protocol}").read_text().splitlines()[1:]
        if line.split()[9] in own
        for address in [readable(line.split()[1])]
    )


def readable(address):
    """Give an address of /proc/net in dotted or colon notation: words of it are little-endian."""
    words = bytes.fromhex(address.partition(":")[0])
    turned = b"".join(words[i : i + 4][::-1] for i in range(0, len(words), 4))
    return socket.inet_ntop(socket.AF_INET if len(turned) == 4 else socket.AF_INET6, turned)


def graph_of(client, name):
    """Give what a node does in the ROS graph, by kind."""
    client.until(lambda: (name, "/rpud") in client.node.get_node_names_and_namespaces())
    found = {}
    for kind in RULES:
        give = getattr(client.node, f"get_{kind}_names_and_types_by_node")
        found[kind] = {topic for topic, _ in give(name, "/rpud")}
    return found


def allowed(name):
    """Give the absolute names that the policy allows to a node, by kind."""
    profile = ElementTree.parse(POLICY).find(f".//profile[@node='{name}']")
    assert profile.get("ns") == "/rpud"
    found = {}
    for kind, (element, qualifier) in RULES.items():
        found[kind] = set()
        for group in profile.findall(f"{element}[@{qualifier}='ALLOW']"):
            for item in group:
                own = item.text.replace("~/", f"/rpud/{name}/")
                found[kind].add(own if own.startswith("/") else f"/rpud/{own}")
    return found


def excess(client, name):
    """Give what a node does and the policy does not allow."""
    rules = allowed(name)
    return {kind: names - rules[kind] for kind, names in graph_of(client, name).items()}


NOTHING = {kind: set() for kind in RULES}


@pytest.fixture
def client(connect):
    return connect("/rpud")


@pytest.fixture
def drill(start_drill):
    return start_drill("/rpud", publish_clock=True)


@loopback_alone
def test_all_sockets_are_bound_to_loopback_and_the_policy_names_all_that_is_offered(
    process, client, drill, tmp_path
):
    recorder = process("recorder", "--out", tmp_path / "bag")
    recorder.wait_for_line("recording")
    client.command(WeightOnBit(force=12.0))  # DDS carries data in both directions
    client.until(lambda: client.status and client.status[-1].commands_accepted == 1)
    for pid in (drill.pid, recorder.pid, os.getpid()):
        assert set(sockets(pid)) == {"127.0.0.1"}
        assert "/dev/shm/fastrtps" not in Path(f"/proc/{pid}/maps").read_text()
    assert excess(client, "drill_node") == NOTHING
    assert excess(client, "recorder") == NOTHING
    recorder.interrupt()
    assert recorder.wait() == 0
    drill.interrupt()
    assert drill.wait() == 0

    replayer = process("replayer", tmp_path / "bag", "--clock", "--start-paused")
    replayer.wait_for_line("replaying")
    client.until(lambda: "/rpud/replayer/seek" in graph_of(client, "replayer")["service"])
    assert set(sockets(replayer.pid)) == {"127.0.0.1"}
    assert excess(client, "replayer") == NOTHING
