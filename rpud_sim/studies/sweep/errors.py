"""Why a sweep is not run, or not to its end."""


class SweepError(ValueError):
    """A sweep that is not possible as it was asked for; its text is one line."""


class WorkerError(RuntimeError):
    """Workers that cannot do what they were asked for; its text is one line."""
