"""Model of the drill: elements of the paper, and the engine from one event to the next.

Where nothing else is said, ``segment`` is a ``SEGMENT`` record, ``state`` a ``STATE`` record,
``drill`` the ``Drill`` and ``rpud`` the ``RpudConstants``. ``states``, ``tallies``,
``open_segments`` and ``open_impacts`` are arrays of one record each. ``turn`` is the
``PhaseSinCos`` of the vibration at the state or at the segment's start, ``turns`` the ``Turns`` at
the end of what is asked for, and ``swing`` a ``DecayingSinCos``. ``met``,
``closed`` and ``opened`` are CONTACT_* bits. ``seconds`` and ``fraction`` are
the whole seconds of a simulation time and the rest of it [s]; ``time`` is since the start of the
segment [s]. Values are in SI units, and positions are positive toward the rock.
"""
