"""Commands that stay out let the drill go down to nothing, as fast as the ramp says."""

from rpud_sim.simulation.control import CommandWatchdog

SECOND = 1_000_000_000


def test_the_share_goes_down_linearly_after_the_timeout():
    watchdog = CommandWatchdog(0.5, 2.0, 3 * SECOND)
    shares = [watchdog.share(3 * SECOND + half * SECOND // 2) for half in range(8)]
    assert shares == [1.0, 1.0, 0.75, 0.5, 0.25, 0.0, 0.0, 0.0]
    assert not watchdog.lost(3 * SECOND + SECOND // 2)
    assert watchdog.lost(3 * SECOND + SECOND // 2 + 1)


def test_the_shortest_timeout_is_one():
    assert CommandWatchdog(1e-15, 0.0).lost(2)
