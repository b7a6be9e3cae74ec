"""A monotonic clock that stands still until a caller sleeps or moves it."""

SECOND = 1_000_000_000


class ManualClock:
    """Calling it gives its time [ns]; `now` may be set."""

    def __init__(self, now=17 * SECOND):
        self.now = now
        self.slept = []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        """Note the time that was slept [s], and move by it."""
        self.slept.append(seconds)
        self.now += round(seconds * SECOND)
