"""One screen of a drill: live, recorded, or frozen into a report.

A live drill is a recording that still grows, a recording is a live drill with a playhead, and a
report is a recording in one file.

==================  ================================================================================
module              what it holds
==================  ================================================================================
``server``          server of the screen: this machine alone, or others with a token
``session``         one browser: what it looks at, what it asks for, and its frames
``picture``         what is drawn of a drill: plots, layers, numbers of a second, the hole
``history``         bins of signals, and impacts, of a run of any length
``commands``        commands of a run in words, and as stepped lines
``live_store``      running drills, each a ``live_drill`` that keeps what was ``heard``
``recorded_store``  a bag: its ``recording``, the ``overview`` of it, and ``views``
``report``          report of a bag: the screen and its data in one file
``share``           the screen itself: HTML, CSS and ES modules, one a concept
==================  ================================================================================
"""
