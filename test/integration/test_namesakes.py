"""Two drills of one name in one domain: both say so, and `rpud run` refuses to be the second."""

import pytest
from support import rpud

pytestmark = pytest.mark.extended

NAME = "/twin/drill_node"


@pytest.fixture
def first(start_drill):
    return start_drill("/twin", "the drill is active")


def run(*words):
    """Run `rpud run` to its end; give exit code and standard error."""
    done = rpud("run", "--namespace", "twin", "--duration", "2.5", "--quiet", *words)
    return done.returncode, done.stderr


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


def test_rpud_run_refuses_to_be_the_second_unless_that_is_allowed(first):
    code, errors = run()
    assert code == 1
    said = f"a drill named {NAME} runs already: choose another --namespace, or give "
    assert errors == f"rpud run: {said}--allow-duplicate\n"
    code, errors = run("--allow-duplicate")
    assert code == 0
    assert f"2 nodes are named {NAME}" in errors
    assert first.running
