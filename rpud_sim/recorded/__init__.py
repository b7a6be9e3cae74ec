"""Recorded runs: proofs, forks, comparisons and exports of bags; and bags of runs without ROS.

A ``report`` is called with what was done since its last call: messages read, samples written, or
simulated seconds. A bag that cannot be read or written raises a ``BagError``, a change or argument
that is rejected a ``ParameterError``, a simulation that cannot continue an ``EngineError``.
Everything else that stops a task is a ``RecordingError``.
"""

from rpud_sim.foundation.quantities import ExpectedError


class RecordingError(ExpectedError):
    """Task on a recording that is not possible; the text gives the reason in one line."""
