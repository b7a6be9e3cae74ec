"""Inspection of bags: reports, exports, rebuilt waveforms, proofs; and bags of offline runs."""
