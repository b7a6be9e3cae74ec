"""One screen of a drill: live, recorded, or frozen into a report.

A recording is a live drill with a playhead, and a report is a recording in one file.

================  ==================================================================================
module            what it holds
================  ==================================================================================
``history``       what a drill has done, and how it is drawn; fed by DDS or by a bag
``borehole``      layers of the rock, and a log of rate and torque by depth
``bins``          bins of signals, and impacts, of a run of any length
``commands``      commands of a run in words, and as stepped lines
``live_history``  history of a running drill, and ``live``: the threads that feed it, and act
``recorded``      history of a drill in a bag, and ``recording``: the bag as it is read
``topic_reader``  signals of one topic from the bytes of its messages
``frames``        what a browser looks at, and what is new for it
``server``        server of the screen: this machine alone, or others with a token
``report``        report of a bag: the screen and its data in one file
``share``         the screen itself: HTML, CSS and ES modules, one a concept
================  ==================================================================================
"""
