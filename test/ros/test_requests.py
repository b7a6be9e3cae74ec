"""Requests are done by one thread, in order, and everyone who asks gets an answer."""

import threading
from concurrent.futures import Future

import pytest

from rpud_sim.ros.threads import Requests, StoppedError


class Worker:
    """A thread that serves until it is stopped, as the pacing thread does."""

    def __init__(self):
        self.wake, self.stop = threading.Event(), threading.Event()
        self.requests = Requests(self.wake.set)
        self.thread = threading.Thread(target=self.run)

    def run(self):
        while not self.stop.is_set():
            self.requests.serve()
            self.wake.wait(0.1)
            self.wake.clear()
        self.requests.close()

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stop.set()
        self.wake.set()
        self.thread.join()


def test_an_action_is_done_in_the_other_thread_and_answered():
    with Worker() as worker:
        assert worker.requests.do(threading.current_thread) is worker.thread
        assert worker.requests.do(lambda: 7) == 7


@pytest.mark.parametrize("kind", [ValueError, TimeoutError, KeyError])
def test_what_an_action_raises_belongs_to_whoever_asked(kind):
    def fail():
        raise kind("of its own")

    with Worker() as worker:
        with pytest.raises(kind, match="of its own"):
            worker.requests.do(fail)
        assert worker.requests.do(lambda: "still there") == "still there"


def test_actions_of_many_threads_are_done_one_by_one_and_each_is_answered():
    done, answers = [], {}

    def ask(number):
        answers[number] = worker.requests.do(lambda: done.append(number) or -number)

    with Worker() as worker:
        askers = [threading.Thread(target=ask, args=(number,)) for number in range(50)]
        for asker in askers:
            asker.start()
        for asker in askers:
            asker.join()
    assert sorted(done) == list(range(50))
    assert answers == {number: -number for number in range(50)}


def test_the_serving_thread_does_its_own_requests_at_once():
    with Worker() as worker:

        def nested():
            inner = worker.requests.do(lambda: worker.requests.do(threading.current_thread))
            assert inner is worker.thread
            with pytest.raises(KeyError):
                worker.requests.do({}.popitem)
            future = worker.requests.do(Future)  # it cannot wait for itself
            return future.done()

        assert worker.requests.do(nested) is False


def test_what_waits_at_the_end_is_refused_and_so_is_all_that_comes():
    waiting = threading.Event()
    requests = Requests(waiting.set)
    refusals = []

    def ask():
        try:
            requests.do(lambda: None)
        except StoppedError as error:
            refusals.append(str(error))

    asker = threading.Thread(target=ask)
    asker.start()
    assert waiting.wait(10.0)
    requests.close()
    asker.join()
    assert refusals == ["the drill has stopped"]
    with pytest.raises(StoppedError, match="the drill has stopped"):
        requests.do(lambda: None)


def test_an_action_that_returns_a_future_is_answered_with_its_result():
    with Worker() as worker:
        future: Future[int] = Future()
        timer = threading.Timer(0.05, future.set_result, [3])
        timer.start()
        assert worker.requests.do(lambda: future) == 3


def test_a_future_that_will_never_be_done_ends_with_the_thread():
    requests = Requests(lambda: requests.serve())
    asker = threading.Thread(target=lambda: refused.append(catch()))
    refused = []

    def catch():
        with pytest.raises(StoppedError) as error:
            requests.do(Future)
        return error

    asker.start()
    requests.close()
    asker.join(10.0)
    assert len(refused) == 1
