"""What is measured, each as a function that returns rows of a table."""

from __future__ import annotations

from bench.engine import engine
from bench.recorder import recorder
from bench.start import start
from bench.telemetry import telemetry

MEASUREMENTS = (engine, start, telemetry, recorder)
