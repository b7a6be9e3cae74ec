"""Log times are the machine's, or those of /clock, and never go back."""

import threading

from rpud_sim.ros.record.log_clock import LogClock


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
