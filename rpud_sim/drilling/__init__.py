"""Processes around the percussion that are slow: rotation, feed and mount, borehole and rock.

Values are in SI units, and positions are positive toward the rock. A step has a length
``interval`` [s]; ``load_spring_rate`` is k_1. A value that is not allowed raises
``ParameterError``, whose text is one line with its name and range.
"""
