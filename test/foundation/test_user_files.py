"""A file that a user names is opened at once or refused, and the error has its path."""

import os
import socket

import pytest
from support import called

from rpud_sim.foundation.atomic_folder import write_atomic
from rpud_sim.foundation.user_files import named_errors, open_file, read_file


def refusal(path):
    with pytest.raises(OSError, match=r".") as error:
        open_file(path)
    return (error.value.filename, error.value.strerror)


def test_what_is_no_regular_file_is_refused_without_waiting(tmp_path):
    fifo, link, its_socket = tmp_path / "fifo", tmp_path / "link", tmp_path / "socket"
    os.mkfifo(fifo)
    link.symlink_to(fifo)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(its_socket))
        for path in (fifo, link, its_socket, "/dev/zero", "/dev/stdin"):
            if path != "/dev/stdin" or not os.path.isfile(path):
                assert refusal(path) == (str(path), "is not a regular file")
    assert refusal(tmp_path) == (str(tmp_path), "Is a directory")
    assert refusal("a\0b") == ("a\0b", "embedded null byte")
    assert refusal(tmp_path / "none") == (str(tmp_path / "none"), "No such file or directory")


def test_a_regular_file_is_read_and_also_by_a_link(tmp_path):
    (tmp_path / "file").write_bytes(b"12345")
    (tmp_path / "link").symlink_to("file")
    assert read_file(tmp_path / "link") == b"12345"
    assert read_file(tmp_path / "file", 3) == b"123"


def test_errors_of_an_open_file_have_the_path(tmp_path):
    with (
        pytest.raises(OSError, match=r"No space left on device: 'out\.csv'"),
        named_errors("out.csv"),
        open("/dev/full", "wb", buffering=0) as full,
    ):
        full.write(b"x")
    with pytest.raises(OSError, match="Is a directory") as error:
        write_atomic(tmp_path, "x")
    assert error.value.filename


@pytest.mark.parametrize(
    "words",
    [
        ("simulate", "--duration", "0.1", "--config", "fifo"),
        ("simulate", "--duration", "0.1", "--set", "scenario=fifo"),
        ("simulate", "--duration", "0.1", "--commands", "fifo"),
        ("sweep", "--points", "fifo"),
        ("test", "fifo.yaml"),
    ],
    ids=" ".join,
)
@pytest.mark.timeout(60)
def test_no_command_waits_for_a_writer(tmp_path, monkeypatch, capsys, words):
    monkeypatch.chdir(tmp_path)
    for name in ("fifo", "fifo.yaml"):
        os.mkfifo(name)
    code, *texts = called(capsys, *words)
    assert code
    assert "regular file" in "".join(texts)
    assert "Traceback" not in "".join(texts)
