"""Reading of bags in a process with little memory."""

import json
import subprocess
import sys

MEMORY = 768 * 2**20  # of address space, that a process may have to read any file
READ_ALL = f"""
import json, pathlib, resource, sys
from rpud_sim.bag import BagError, open
from rpud_sim.bag.recovery import recover
resource.setrlimit(resource.RLIMIT_AS, ({MEMORY}, {MEMORY}))
def read(path):
    with open(path) as bag:
        bag.topics, bag.records("notes")
        return sum(1 for _ in bag.messages())
def recovered(path):
    return recover(path, path.parent / "recovered" / path.name).message_count
def said(task, path):
    try:
        return str(task(path))
    except BagError as error:
        return str(error)
for path in sorted(pathlib.Path(sys.argv[1]).iterdir()):
    print(json.dumps([path.name, said(read, path), said(recovered, path)]), flush=True)
"""


def read_in_bounded_memory(folder):
    """Read and recover the bags of a folder in a process with little memory; return its output."""
    result = subprocess.run(
        [sys.executable, "-c", READ_ALL, folder],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr[-2000:]
    return {name: said for name, *said in map(json.loads, result.stdout.splitlines())}
