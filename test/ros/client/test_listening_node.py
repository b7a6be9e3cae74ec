"""A node that takes messages while its owner waits."""

import pytest
from std_msgs.msg import String
from std_srvs.srv import Empty
from support import PATIENCE

from rpud_sim.ros.client import listening_node
from rpud_sim.ros.client.listening_node import ListeningNode


@pytest.fixture
def listening():
    with ListeningNode("listener", "/kept", patience=PATIENCE) as listening:
        yield listening


def call(node, served):
    def answer(request, response):
        served.append(request)
        return response

    node.create_service(Empty, "empty", answer)
    client = node.create_client(Empty, "empty")
    assert client.wait_for_service(PATIENCE)
    client.call_async(Empty.Request())


@pytest.mark.parametrize(
    "make",
    [
        lambda node, served: node.create_timer(0.01, lambda: served.append(None)),
        lambda node, served: node.create_subscription(String, "busy", served.append, 10),
        call,
    ],
)
def test_what_its_owner_has_made_is_served_while_messages_keep_coming(listening, monkeypatch, make):
    """The executor, which costs more than a message, has no turn beside messages otherwise."""
    monkeypatch.setattr(listening_node, "_REFRESH_PERIOD", float("inf"))
    node, taken, served = listening.node, [], []
    listening.subscribe(String, "busy", lambda *message: taken.append(message))
    publisher = node.create_publisher(String, "busy", 10)
    make(node, served)

    def busy():
        publisher.publish(String(data="busy"))
        return served

    listening.wait_until(lambda: publisher.get_subscription_count() > 0, "no connection")
    listening.wait_until(busy, "it was not served")
    assert taken
