"""The store of a drill keeps the newest entries of its journal, with their publishing times."""

import time

from rpud_sim.ros.drill.publishers import JournalStore


def stored(count, **most):
    store = JournalStore(**most)
    for number in range(count):
        store.add(b"entry %d" % number)
    return store


def numbers(entries):
    return [int(data.split()[1]) for _, data in entries]


def test_all_entries_are_read_page_by_page():
    before = time.time_ns()
    store = stored(1234)
    found, pages = [], 0
    while page := store.read(len(found)):
        assert len(page) <= 1000
        found += page
        pages += 1
    assert numbers(found) == list(range(1234))
    times = [published for published, _ in found]
    assert times == sorted(times)
    assert before <= times[0] <= times[-1] <= time.time_ns()
    assert pages == 3
    assert numbers(store.read(499)) == [499]
    assert numbers(store.read(1200)) == list(range(1200, 1234))


def test_the_oldest_are_dropped_and_counted():
    store = stored(2600, most=1000)
    assert (store.count, store.first_kept) == (2600, 1500)
    assert numbers(store.read(0)) == list(range(1500, 2000))
    assert numbers(store.read(2500)) == list(range(2500, 2600))
    assert store.read(2600) == store.read(2**64 - 1) == []
