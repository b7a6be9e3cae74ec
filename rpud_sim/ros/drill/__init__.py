"""The drill as a managed node.

::

    topics   -> CommandTopics -> Inbox -> Session.act; results back from Inbox
    services -> PacingLoop.request -> Session, Timeline
    PacingLoop: Session.advance, wait for Timeline.pacer, Session.publish, Session.act, report
    Session  -> DrillPublishers, StatusReporter
"""
