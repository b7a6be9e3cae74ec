"""The command line: one file per command of rpud.

A signal while a program of this package still loads waits until its handlers are installed.
"""

from __future__ import annotations

import os
import signal
import sys

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a program."""

if os.path.basename(sys.argv[0]) in ("rpud", "drill_node", "recorder", "replayer"):
    signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
