"""Two drills of one name in one domain: both say so, and `rpud run` refuses to be the second."""

import pytest

pytestmark = pytest.mark.extended

NAME = "/twin/drill_node"


@pytest.fixture
def first(start_drill):
    return start_drill("/twin", "the drill is active")


def test_both_say_so_in_the_log_and_in_the_diagnostics(first, start_drill, connect):
    warning = f"WARN.*: 2 nodes are named {NAME}: all of them answer the same"
    second = start_drill("/twin", warning, autostart=False)
    first.wait_for_line(warning)
    client = connect("/twin")
    diagnostics = client.listen("/diagnostics")
    client.until(
        lambda: any(
            status.message == "2 nodes have this name"
            for message in diagnostics
            for status in message.status
        )
    )
    second.stop()
    client.until(
        lambda: "running" in [status.message for status in diagnostics[-1].status]  # of the drill
    )
