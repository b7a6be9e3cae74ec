"""Model of the drill: elements of the paper, and the engine from one event to the next.

Unless noted otherwise, ``segment``, ``impact``, ``state`` and ``tally`` are records of
``SEGMENT``, ``IMPACT``, ``STATE`` and ``TALLY`` (with an ``s`` or ``open_``: arrays of them),
``drill`` the ``DrillConstants`` and ``rpud`` the ``RpudConstants``. ``turn`` is the
``PhaseSinCos`` of the vibration at the state or at the segment's start, ``turns`` the ``Turns`` at
the end of what is asked for, and ``swing`` a ``DecayingSinCos``. ``met``, ``closed`` and ``opened``
are CONTACT_* bits. ``seconds`` and ``fraction`` are the whole seconds of a simulation time and the
rest of it [s]; ``time`` is since the start of the segment [s], phases are in cycles. Values are in
SI units, and positions are positive toward the rock: of nodal plane (np), tip (ut), free mass (fm)
and drill tool (dt).
"""
