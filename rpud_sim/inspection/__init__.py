"""Inspection of bags: reports, exports, rebuilt waveforms, proofs; and bags of offline runs.

A ``report`` is called with what was done since its last call: messages read, samples written, or
simulated seconds. A bag that cannot be read or written raises a ``BagError``, a change or argument
that is refused a ``ParameterError``, a simulation that cannot go on an ``EngineError``. All else
that stops a task has the error of its module: ``CompareError``, ``ExportError``, ``ForkError``,
``RebuildError``, ``ReportError`` or ``UnverifiableError``.
"""
