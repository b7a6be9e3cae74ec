"""Kill recordings at random moments, recover each, and see that nothing is missing but its end.

`python -m tools.kills --count 1000` kills a recorder's writing half, fed at some 10,000 messages a
second; `--live` kills whole recorders on a running ROS system. `make kills` does both.
"""

from __future__ import annotations

import argparse
import mmap
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import nullcontext
from multiprocessing.pool import ThreadPool
from pathlib import Path

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Message, Topic
from rpud_sim.bag.recovery import recover
from rpud_sim.ros.record.writing import WriteQueue, WritingThread
from rpud_sim.testing.processes import DomainClaim
from tools import LOOPBACK

FORCES = "/rpud/contact_force"
TOPICS = ("/a", "/b", "/c")
RECORDERS = 2  # at a time
ROOT = Path(__file__).parents[1]


class WatchedWriter(BagWriter):
    """Tells in shared memory how many messages are on the disk, and when the first one came."""

    def __init__(self, path: Path, shared: mmap.mmap, **options) -> None:
        self._shared = shared
        super().__init__(path, **options)

    def flush(self) -> None:
        count = self.message_count if hasattr(self, "_counts") else 0
        super().flush()
        self._shared[:8] = count.to_bytes(8, "little")


def record_for_ever(path: Path, shared: mmap.mmap, max_loss: float, **options) -> None:
    """Write numbered messages on all topics until the end of this process."""
    intake = WriteQueue()
    bag = WatchedWriter(path, shared, **options)
    WritingThread(intake, bag, max_loss, os.abort).start()
    for name in TOPICS:
        intake.declare(Topic(name, "std_msgs/msg/String"), "string data\n")
    shared[8:] = time.time_ns().to_bytes(8, "little")
    number = 0
    while True:
        for name in TOPICS:
            now = time.time_ns()
            intake.put(Message(name, now, now, number.to_bytes(8, "little") * 20))
        number += 1
        time.sleep(0.0002)


def kill_writer(folder: Path, drawn: random.Random, max_loss: float) -> float:
    """Kill one writer and check what is left; return how much was lost [s]."""
    shared = mmap.mmap(-1, 16)
    path = folder / "torn"
    chunk_size = drawn.choice([1000, 30_000, 1 << 20])
    compression = drawn.choice(["none", "zstd"])
    child = os.fork()
    if child == 0:
        try:
            record_for_ever(path, shared, max_loss, chunk_size=chunk_size, compression=compression)
        finally:
            os._exit(1)
    time.sleep(drawn.uniform(0.0, 1.5 * max_loss))
    killed = time.time_ns()
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    safe = int.from_bytes(shared[:8], "little")
    began = int.from_bytes(shared[8:], "little") or killed
    if not list(path.glob("*.mcap")):
        return 0.0  # before it began
    file = next(path.glob("*.mcap"))
    if file.stat().st_size < 8:
        assert safe == 0
        return 0.0
    recover(path, folder / "whole")
    found: dict[str, list[int]] = {name: [] for name in TOPICS}
    last = began
    with rpud_sim.bag.open(folder / "whole") as bag:
        for message in bag.messages():
            assert message.data == message.data[:8] * 20
            found[message.topic].append(int.from_bytes(message.data[:8], "little"))
            last = message.log_time
        count = bag.message_count
    for name, numbers in found.items():
        assert numbers == list(range(len(numbers))), f"{name} is no prefix without a gap"
    assert count >= safe, f"{safe} messages were on the disk, {count} were recovered"
    return (killed - last) / 1e9


def kill_recorder(folder: Path, drawn: random.Random, max_loss: float) -> float:
    """Kill one recorder of a running talker and check what is left; return the loss [s]."""
    path = folder / "torn"
    recorder = subprocess.Popen(
        [
            *(sys.executable, "-m", "rpud_sim.cli.main", "record"),
            *("--out", str(path), "--max-loss", str(max_loss)),
        ],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert recorder.stderr is not None
    for line in recorder.stderr:
        if "topics to" in line:
            break
    threading.Thread(target=recorder.stderr.read, daemon=True).start()
    time.sleep(drawn.uniform(0.0, 1.5 * max_loss))
    killed = time.time_ns()
    recorder.kill()
    recorder.wait()
    recovery = recover(path, folder / "whole")
    forces = recovery.topics.get(FORCES)
    if forces is None or not forces.recovered:
        return 0.0  # it may have been too early for them
    with rpud_sim.bag.open(folder / "whole") as bag:
        numbers = bag.arrays(FORCES)["sequence"]
        assert (numbers[1:] == numbers[:-1] + 1).all(), "impacts are missing in between"
        last = next(topic.last_time for topic in bag.topics if topic.topic.name == FORCES)
    return (killed - last) / 1e9


def main() -> None:
    """Kill as often as asked, and print what it cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--max-loss", type=float, default=0.5)
    parser.add_argument("--live", action="store_true", help="whole recorders over DDS")
    parser.add_argument("--any-loss", action="store_true", help="do not hold the time to the bound")
    parser.add_argument("--seed", type=int, default=random.randrange(10**6))
    arguments = parser.parse_args()
    kill = kill_recorder if arguments.live else kill_writer
    talker = None
    if arguments.live:
        claim = DomainClaim()  # held to the end, for this process alone
        os.environ.update(ROS_DOMAIN_ID=str(claim.domain), **LOOPBACK)
        program = str(ROOT / "test" / "helpers" / "talker.py")
        talker = subprocess.Popen(
            [sys.executable, program, "--count", str(10**9), "--rate", "1000"],
            stdout=subprocess.DEVNULL,
        )

    def one(number: int) -> float:
        folder = Path(tempfile.mkdtemp(prefix="rpud_kills_"))
        loss = kill(folder, random.Random(f"{arguments.seed}:{number}"), arguments.max_loss)
        text = f"kill {number} of seed {arguments.seed} cost {loss:.3f} s: see {folder}"
        assert arguments.any_loss or loss <= arguments.max_loss, text
        shutil.rmtree(folder)
        return loss

    try:
        # Recorders start and wait most of their time; a writer is forked, where no thread may be.
        with ThreadPool(RECORDERS) if arguments.live else nullcontext() as pool:
            losses = sorted((pool.imap_unordered if pool else map)(one, range(arguments.count)))
    finally:
        if talker is not None:
            talker.kill()
            talker.wait()
    print(
        f"{len(losses)} kills with --max-loss {arguments.max_loss:g} s, each recovered without a "
        f"gap; lost {losses[len(losses) // 2]:.3f} s in the median, {losses[-1]:.3f} s at most"
    )


if __name__ == "__main__":
    main()
