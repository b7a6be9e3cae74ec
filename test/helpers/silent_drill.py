"""Drill in this process that a test commands and advances, without messages."""

from rpud_sim.simulation.block import join_blocks
from rpud_sim.simulation.changes import Clear, Configure, Inject
from rpud_sim.simulation.configuration import Settings, to_values, with_defaults
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run


class SilentDrill:
    """Run of a drill whose blocks a test gets; what it is not asked for is its simulation's."""

    def __init__(
        self, configuration, initial_phase=0.0, faults=(), journal=None, rejected=None, **values
    ):
        self._blocks = []
        settings = Settings(with_defaults(configuration), **values)
        plan = Plan(Beginning(settings, initial_phase, faults=tuple(faults)))
        self.run = Run(plan, journal, None, on_block=self._keep, rejected=rejected)
        if "command_timeout" in values:
            self.run.take_over()

    def __getattr__(self, name):
        if name == "run":  # while it is copied
            raise AttributeError(name)
        return getattr(self.run.simulation, name)

    def _keep(self, block):  # a method, so that a copy of the drill keeps its own blocks
        self._blocks.append(block)

    def advance_to(self, time):
        """Advance to a time [ns], and return the block up to there."""
        self._blocks.clear()
        if time <= self.time:
            return self.run.simulation.advance_to(time)
        self.run.finish(time)
        return join_blocks(self._blocks)

    def apply(self, command):
        self.run.apply(command)

    def inject(self, fault, duration=0):
        return self.run.apply(Inject(fault, duration))[0]

    def clear(self, number=0):
        return self.run.apply(Clear(number))

    def configure(self, configuration):
        self.run.apply(Configure(to_values(configuration)))


def plans_of(configuration, phases, changes=()):
    """Return a plan for each initial phase [cycles]."""
    settings = Settings(with_defaults(configuration))
    return [Plan(Beginning(settings, phase), tuple(changes)) for phase in phases]
