"""Files of others that the screen uses are those that were published."""

import hashlib
import re
from pathlib import Path

import rpud_sim.viewer

VENDOR = Path(rpud_sim.viewer.__file__).parent / "share" / "vendor"


def test_every_file_has_the_digest_that_is_noted():
    noted = dict(re.findall(r"`(\S+)` \| `([0-9a-f]{64})`", (VENDOR / "README.md").read_text()))
    files = {path.name: path for path in VENDOR.iterdir() if path.name != "README.md"}
    assert files.keys() == noted.keys()
    for name, path in files.items():
        assert hashlib.sha256(path.read_bytes()).hexdigest() == noted[name], name
