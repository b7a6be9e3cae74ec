"""What arrives over the network ends no recording."""

from rclpy.logging import get_logger

from rpud_sim.ros.record.network_guard import NetworkGuard


def test_errors_are_passed_over_counted_and_logged_once_in_a_while(capfd):
    guard = NetworkGuard(get_logger("recorder"))
    for number in range(5):
        with guard("an answer of /stranger"):
            raise OverflowError(f"number\n{number}")
    with guard("an answer of /stranger"):
        pass
    assert guard.count == 5
    [line] = capfd.readouterr().err.splitlines()
    assert line.endswith("an answer of /stranger cannot be used: OverflowError: number 0")
