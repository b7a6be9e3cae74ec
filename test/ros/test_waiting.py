"""Waiting without an executor: requests are answered in a thread, and responses reach who waits."""

from __future__ import annotations

import threading
import time

import pytest
import rclpy
from std_srvs.srv import SetBool

from rpud_sim.ros.waiting import OwnGroup, ServiceThread, WaitSet, take_responses


@pytest.fixture
def failures():
    return []


@pytest.fixture
def pair(nodes, failures):
    """Client, and the events by which the answers of its service wait and go on."""
    nodes += [rclpy.create_node("server"), rclpy.create_node("caller")]
    server, caller = nodes
    begun, go_on = threading.Event(), threading.Event()

    def answer(request, response):
        begun.set()
        go_on.wait(10.0)
        response.success = request.data
        return response

    service = server.create_service(SetBool, "answer", answer, callback_group=OwnGroup())
    thread = ServiceThread(server.context, [service], failures.append)
    client = caller.create_client(SetBool, "answer")
    assert client.wait_for_service(10.0)
    yield client, begun, go_on, thread
    go_on.set()
    thread.close(10.0)
    assert not failures


def answered(client, future):
    waiting = WaitSet(client.context)
    while not future.done():
        assert waiting.wait(10.0, clients=[client])
        take_responses(client)
    return future.result()


def test_a_response_reaches_who_awaits_it(pair):
    client, _, go_on, _ = pair
    go_on.set()
    futures = [client.call_async(SetBool.Request(data=value)) for value in (True, False)]
    assert [answered(client, future).success for future in futures] == [True, False]


def test_a_response_that_nobody_awaits_any_more_is_dropped(pair):
    client, begun, go_on, _ = pair
    forgotten = client.call_async(SetBool.Request(data=True))
    assert begun.wait(10.0)
    client.remove_pending_request(forgotten)
    go_on.set()
    assert answered(client, client.call_async(SetBool.Request(data=True))).success
    assert not forgotten.done()


def test_the_answer_under_way_is_sent_before_the_thread_ends(pair):
    client, begun, go_on, thread = pair
    future = client.call_async(SetBool.Request(data=True))
    assert begun.wait(10.0)
    threading.Timer(0.05, go_on.set).start()
    thread.close(10.0)
    assert answered(client, future).success


def test_an_executor_leaves_an_own_group_to_its_thread(pair, nodes):
    client, begun, go_on, _ = pair
    client.call_async(SetBool.Request(data=True))
    assert begun.wait(10.0)
    begun.clear()
    waiting = client.call_async(SetBool.Request(data=True))
    rclpy.spin_once(nodes[0], timeout_sec=0.2)
    assert not begun.is_set()  # the thread is busy with the first
    go_on.set()
    assert answered(client, waiting).success


def test_a_wait_for_nothing_ends(pair):
    client, *_ = pair
    assert not WaitSet(client.context).wait(0.01)


def test_a_thread_ends_without_waiting_for_a_request(pair):
    _, _, _, thread = pair
    begun = time.monotonic()
    for _ in range(20):  # each would take half a second
        other = ServiceThread(pair[0].context, thread._services, pytest.fail)
        other.close(10.0)
        assert not other._thread.is_alive()
    assert time.monotonic() - begun < 5.0
