"""Kernel over many blocks in one call, for runs that nothing changes from outside."""

from rpud_sim.model.compile import compiled
from rpud_sim.model.events import DONE, advance


@compiled
def advance_through(
    drill,
    states,
    open_segments,
    open_impacts,
    seconds,
    fractions,
    segments,
    impacts,
    finished,
    struck,
):
    """Advance to times one after the other, as far as the room for results reaches.

    Args:
        seconds: whole seconds of the times, in ascending order.
        impacts: room for finished impacts, at least two more than segments.
        finished: gets the number of segments that were finished at each time.
        struck: gets the number of impacts that were finished at each time.

    Returns:
        The status of the last ``advance``, the number of times that were reached, and the numbers
        of finished segments and impacts.
    """
    written = 0
    count = 0
    for k in range(len(seconds)):
        status, more, hits = advance(
            drill,
            states,
            open_segments,
            open_impacts,
            seconds[k],
            fractions[k],
            segments[written:],
            impacts[count:],
        )
        written += more
        count += hits
        if status != DONE:
            return status, k, written, count
        finished[k] = written
        struck[k] = count
    return DONE, len(seconds), written, count
