"""`rpud watch BAG`: it prints the address, ends at a signal, and names what it cannot show."""

import socket
import urllib.request

import pytest

from rpud_sim.cli.main import main


def test_it_prints_where_the_page_is_and_ends_at_a_signal(process, drill_bag):
    server = process("rpud", "watch", drill_bag, "--port", "0")
    url = server.wait_for_line(r"bag .*: (http://127\.0\.0\.1:\d+/bag)$")[1]
    with urllib.request.urlopen(url) as answer:
        page = answer.read().decode()
    assert "<title>bag</title>" in page
    assert "https://" not in page.partition("<script>")[0]
    server.terminate()
    assert server.wait() == 0


def test_no_bag_and_a_port_in_use_are_one_line(drill_bag, capsys, tmp_path):
    assert code_of(["watch", str(tmp_path / "none")]) == 1
    last = capsys.readouterr().err.splitlines()[-1]  # rclpy may complain of another test's node
    assert last == f"rpud watch: there is no bag at {tmp_path / 'none'}"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert code_of(["watch", str(drill_bag), "--port", str(port)]) == 1
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"rpud watch: port {port} of 127.0.0.1 is in use: choose another one with --port, "
        "or 0 for a free one"
    )


def test_a_wrong_port_is_a_wrong_call():
    assert code_of(["watch", "bag", "--port", "70000"]) == 2


def code_of(command):
    """Return the exit code of a command."""
    with pytest.raises(SystemExit) as end:
        main(command)
    return end.value.code
