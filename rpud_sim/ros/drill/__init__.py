"""The drill as a managed node.

``DrillNode`` makes a ``LiveRun`` when it is configured. From its activation on the one thread of
its ``PacingLoop`` moves and changes it::

    topics   -> CommandTopic -> Inbox -> LiveRun.turn: read commands, advance, publish, sleep
    services -> PacingLoop.request -> LiveRun: play, pause, step, reset, configure
    LiveRun  -> DrillPublishers, StatusReporter; Pacer and TimeSource give its times
"""
