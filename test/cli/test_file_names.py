"""Names of files are bytes: any locale and any folder will do."""

import os
import subprocess
import sys

import pytest
from sample_bags import write_bag
from support import called

import rpud_sim.bag
from rpud_sim.bag.metadata import MANIFEST_RECORD, manifest_from_record


def rpud(folder, *words, **environment):
    return subprocess.run(
        [sys.executable, "-m", "rpud_sim.cli.main", *words],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        check=False,
    )


WORDS = (
    ["info", "{bag}"],
    ["report", "{bag}", "--out", "{new}.html"],
    ["export", "{bag}", "--out", "{new}", "--format", "csv"],
    ["recover", "{bag}", "--out", "{new}"],
    ["simulate", "--duration", "0.1", "--bag", "{new}"],
)
every_command = pytest.mark.parametrize("words", WORDS, ids=lambda words: words[0])


@every_command
def test_the_locale_is_no_damage(tmp_path, words):
    write_bag(tmp_path / "größe")
    words = [word.format(bag="größe", new="ä") for word in words]
    done = rpud(tmp_path, *words, LC_ALL="C", PYTHONUTF8="0")
    assert (done.returncode, done.stderr) == (0, b"")
    for path in tmp_path.glob("ä/metadata.yaml"):
        with rpud_sim.bag.open(path.parent) as bag:
            assert bag.message_count > 0
            manifests = [manifest_from_record(record) for record in bag.records(MANIFEST_RECORD)]
        assert "ä_0.mcap" in path.read_text(encoding="utf-8")
        assert all(manifest.command[-1] == "ä" for manifest in manifests)


@every_command
def test_a_folder_may_have_any_name(capsys, monkeypatch, tmp_path, words):
    folder = tmp_path / os.fsdecode(b"\xff")
    folder.mkdir()
    write_bag(folder / "bag")
    monkeypatch.chdir(tmp_path)
    names = {"bag": os.fsdecode(b"\xff/bag"), "new": os.fsdecode(b"\xff/new")}
    code, _, errors = called(capsys, *(word.format(**names) for word in words))
    assert (code, errors) == (0, "")
    if words[0] in ("recover", "simulate"):
        assert called(capsys, "info", names["new"])[0] == 0


@pytest.mark.parametrize(
    "words", [["recover", "bag", "--out"], ["simulate", "--duration", "0.1", "--bag"]]
)
def test_a_bag_s_own_name_must_be_utf_8(tmp_path, words):
    write_bag(tmp_path / "bag")
    done = rpud(tmp_path, *words, b"\xff")
    reason = rf"rpud {words[0]}: the name '\udcff' is not UTF-8, as a bag's must be"
    assert (done.returncode, done.stderr.decode().strip()) == (1, reason)
    assert os.listdir(os.fsencode(tmp_path)) == [b"bag"]
