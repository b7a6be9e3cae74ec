"""Waiting for some subscriptions, clients and services without an executor.

rclpy's executors make their wait sets in Python from every entity of a node, at each turn. That
costs more than a step of the drill.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.service import Service
from rclpy.subscription import Subscription

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.threads import raised

_LONGEST_WAIT = 1.0  # of a thread, between looks at whether its node is there [s]


class WaitSet:
    """Subscriptions, clients and services that are awaited together; from one thread.

    ``wake`` ends a wait, from any thread.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._guard = rclpy_implementation.GuardCondition(context.handle)
        self.wake = self._guard.trigger_guard_condition
        self._sizes = (-1, -1, -1)
        self._wait_set: Any = None

    def wait(
        self,
        seconds: float,
        subscriptions: Iterable[Subscription] = (),
        clients: Iterable[Client] = (),
        services: Iterable[Service] = (),
    ) -> list[Any]:
        """Wait until one of them has something to take; return those that have, in time [s]."""
        kinds: list[list[Any]] = [*map(list, (subscriptions, clients, services))]
        readers, callers, servers = [[each.handle for each in kind] for kind in kinds]
        if not (readers or callers or servers):
            time.sleep(seconds)
            return []
        if self._sizes != (sizes := (len(readers), len(callers), len(servers))):
            self._sizes = sizes
            self._wait_set = rclpy_implementation.WaitSet(
                sizes[0], 1, 0, sizes[1], sizes[2], 0, self._context.handle
            )
        found = self._wait_set
        found.clear_entities()
        found.add_guard_condition(self._guard)
        for handle in readers:
            found.add_subscription(handle)
        for handle in callers:
            found.add_client(handle)
        for handle in servers:
            found.add_service(handle)
        found.wait(round(seconds * SECOND))
        ready = [found.get_ready_entities(kind) for kind in ("subscription", "client", "service")]
        return [
            each
            for entities, pointers in zip(kinds, ready, strict=True)
            if pointers
            for each in entities
            if each.handle.pointer in pointers
        ]


def take_responses(client: Client) -> None:
    """Take the responses that have arrived at a client, for those who await them."""
    kind: Any = client.srv_type
    with client.handle:
        while (found := client.handle.take_response(kind.Response))[0] is not None:
            header, response = found
            try:
                future = client.get_pending_request(header.request_id.sequence_number)
            except KeyError:  # nobody awaits it any more
                continue
            future.set_result(response)


class OwnGroup(CallbackGroup):
    """Group of entities that an executor leaves to a thread of their own."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        pass


class ServiceThread:
    """Thread that answers requests to services of an ``OwnGroup``, one at a time.

    ``failed`` is called with one line where rclpy raises an error at a request.
    """

    def __init__(
        self, context: Context, services: Iterable[Service], failed: Callable[[str], None]
    ) -> None:
        self._services = list(services)
        self._failed = failed
        self._closed = threading.Event()
        self._waiting = WaitSet(context)
        self._thread = threading.Thread(target=self._run, name="services", daemon=True)
        self._thread.start()

    def close(self, seconds: float) -> None:
        """Answer no more; wait for the answer that is under way [s]."""
        self._closed.set()
        self._waiting.wake()
        self._thread.join(seconds)

    def _run(self) -> None:
        while not self._closed.is_set():
            try:
                for service in self._waiting.wait(_LONGEST_WAIT, services=self._services):
                    _answer(service)
            except InvalidHandle:  # the node has been destroyed
                return
            except Exception as error:
                self._failed(raised(error))


def _answer(service: Service) -> None:
    """Answer a request to a service, if there is one."""
    kind: Any = service.srv_type
    with service.handle:
        request, header = service.handle.service_take_request(kind.Request)
        if header is not None:
            response = service.callback(request, kind.Response())
            service.send_response(response, header)
