"""Log times are the machine's, or those of /clock, and never go back."""

import threading

import pytest

from rpud_sim.ros.record.log_clock import LogClock, ReceptionTime

MS = 1_000_000


def test_a_message_has_the_time_of_the_latest_tick_before_it():
    clock = LogClock()
    clock.use_simulation()
    waiting = threading.Thread(target=clock.wait)
    waiting.start()
    clock.add(1000, 0)
    waiting.join(10.0)
    assert not waiting.is_alive()
    for received, time in ((1010, 10), (1020, 20), (1030, 30)):
        clock.add(received, time)
    assert [clock.at(received) for received in (900, 1009, 1010, 1025, 2000)] == [0, 0, 10, 20, 30]
    assert clock.finish()


def test_a_clock_that_goes_back_goes_on_from_there():
    clock = LogClock()
    clock.use_simulation()
    times = []
    for received, time in enumerate((5, 9, 0, 4, 1, 2, 7)):
        clock.add(received, time)
        times.append(clock.at(received))
    assert times == [5, 9, 9, 13, 13, 14, 19]


def test_without_a_tick_the_machine_s_clock_counts():
    clock = LogClock()
    clock.use_simulation()
    assert not clock.finish()
    clock.wait()
    assert clock.at(77) == 77
    machine = LogClock()
    machine.use_machine()
    machine.add(1, 2)
    assert (machine.at(77), machine.finish(), machine.decided) == (77, True, True)


@pytest.mark.parametrize("back", [5, 500, 3_600_000])
def test_messages_keep_their_order_when_the_clock_of_the_machine_is_set_back(back):
    age, set_back = 0, 0

    def wall():
        return 10**18 + age * MS - set_back * MS

    reception = ReceptionTime(wall, lambda: age * MS)
    found, waiting, latest = [], [], 0
    for age in range(1, 40):
        set_back = back * (age >= 20)
        waiting.append(wall())
        if age % 4 == 0:  # some of those that wait came before the step
            for received in waiting:
                found.append(reception.of(received, received - MS // 2, latest))
                latest = found[-1][0]
            waiting = []
    logged = [came for came, _ in found]
    assert logged == sorted(logged)
    assert all(0 <= came - begun <= 4 * MS for came, begun in found)
    assert logged[-1] - logged[0] <= 39 * MS
    assert reception.shift == back * MS
    set_back = 0
    assert reception.now() == wall()


def test_a_clock_that_drifts_is_followed():
    now = [10**18, 0]
    reception = ReceptionTime(lambda: now[0], lambda: now[1])
    for _ in range(1000):
        now[0] += 10 * MS - 5000  # 500 ppm
        now[1] += 10 * MS
        assert reception.now() == now[0]
