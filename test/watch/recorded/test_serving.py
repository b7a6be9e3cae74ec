"""`rpud watch BAG`: it prints the address, ends at a signal, and names what it cannot show."""

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


def test_no_bag_is_one_line(capsys, tmp_path):
    with pytest.raises(SystemExit) as end:
        main(["watch", str(tmp_path / "none")])
    assert end.value.code == 1
    last = capsys.readouterr().err.splitlines()[-1]  # rclpy may complain of another test's node
    assert last == f"rpud watch: there is no bag at {tmp_path / 'none'}"
