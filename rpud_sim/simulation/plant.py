"""Plant: engine, actuator and slow processes, which advance together."""

from __future__ import annotations

import math

import numpy as np

from rpud_sim.drilling.borehole import Borehole
from rpud_sim.drilling.mount import Motion, Mount, MountMotion
from rpud_sim.drilling.process import Process
from rpud_sim.drilling.rock import PercussionDepth
from rpud_sim.drilling.rotor import Rotor
from rpud_sim.foundation.time import NEVER, SECOND, split_fraction
from rpud_sim.model.drill import DrillConstants, derive
from rpud_sim.model.energy import RpudConstants, withdrawal_work
from rpud_sim.model.engine import Buffers, Engine, EngineError
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.resonator import Resonance
from rpud_sim.model.segment import IMPACT, SEGMENT, join_records, motion_at
from rpud_sim.simulation.actuator import Actuator, ActuatorReading
from rpud_sim.simulation.commands import Drive
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.energy_account import FeedAccount
from rpud_sim.simulation.fault_kinds import FaultEffects
from rpud_sim.simulation.faults import effects_of
from rpud_sim.simulation.percussion import LoadSpring, PercussionMeter, nodal_plane_position


def rpud_constants(parameters: Parameters, resonance: Resonance | None) -> RpudConstants:
    return RpudConstants(
        parameters.rpud_mass,
        parameters.gravity_on_drill,
        0.0 if resonance is None else 1.0 / resonance.mass,
    )


# Energy that the steps of an arm may create in a second, beside the energy of impacts [J].
LEAST_CREATED = 1.0


class Plant:
    """Motion of the drill, amplitude of its actuator and depth of its hole, from time zero on.

    Times are integer nanoseconds of simulation time.
    """

    def __init__(
        self,
        configuration: Configuration,
        initial_phase: float,
        drive: Drive,
        buffers: Buffers | None = None,
    ) -> None:
        parameters = configuration.parameters
        self.time = 0  # simulation time [ns]
        self._instant = (0, 0.0)  # the same as whole seconds and the rest of them [s]
        # commanded force [N]; a change takes effect at the current time. Without effect
        # where the weight on bit follows from a feed.
        self.weight_on_bit = parameters.weight_on_bit
        # depth into the rock by percussion alone
        self.progress = PercussionDepth(configuration.rock, parameters.tool_length)
        self._effects = effects_of((), parameters)
        # rotation, feed and borehole
        self.process = self._new_process(configuration)
        mount = self.process.mount
        if mount is not None:
            parameters = self._acting_parameters().replace(weight_on_bit=mount.weight_on_bit)
        self._passed = 0.0  # distance passed by the bodies' origin, not yet in the engine [m]
        # drive, generator and temperature
        self.actuator = Actuator(configuration.actuator, parameters.vibration_amplitude, drive)
        self._drill = derive(parameters)
        self._segments: list[np.ndarray] = []
        self._impacts: list[np.ndarray] = []
        self._counted = 0  # impacts in the engine that the meter has counted
        self._percussion: PercussionMeter | None = None
        self._load_spring: LoadSpring | None = None
        self._checked = (0.0, 0.0)  # coupling and energy of impacts at the last whole second [J]
        start = (parameters, initial_phase, self.actuator.level > 0.0, self.actuator.resonance)
        self.engine = Engine(*start, buffers)  # engine of the motion
        if self.process.next_step != NEVER:
            position = nodal_plane_position(self.engine.open_segment, *self._instant)
            nominal = parameters.vibration_amplitude
            self._percussion = PercussionMeter(nominal, position, parameters.weight_on_bit)
            if mount is not None:
                compression, rate = mount.advance.compression, self._pushing_rate()
                stored = mount.state.work.stored
                self._load_spring = LoadSpring(stored, compression, rate, position)
        # furthest time of one advance [ns]
        self.next_step = min(self.actuator.next_step, self.process.next_step)
        self._in_force = (self._drill, *self._commands())

    def _new_process(self, drill: Configuration) -> Process:
        length = drill.parameters.tool_length
        rotor = mount = borehole = None
        if drill.rotates:
            rotor = Rotor(drill.rotation)
        if drill.has_feed:
            mount = Mount(drill.mount, self._pushing_rate(), self._bottom() < math.inf)
        if (layers := drill.layers) is not None:
            borehole = Borehole(drill.bit, layers, drill.rock, length)
        return Process(rotor, mount, borehole, self._stiffness if mount else 0.0)

    @property
    def _stiffness(self) -> float:
        """Rate of the load spring over the RPUD's mass [1/s^2], without a binding."""
        return self._effects.pushing_rate / self._effects.parameters.rpud_mass

    @property
    def reading(self) -> ActuatorReading:
        account = self.engine.account(*self._instant)
        return self.actuator.read(self.engine.amplitude, account, self.process.draw)

    def advance_to(self, time: int) -> None:
        """Advance to a time [ns], not beyond the next step."""
        self._push_to_engine()
        instant = split_fraction(time)
        self.engine.advance(*instant)
        at_step = time == self.next_step
        if at_step and time == self.actuator.next_step:
            self.actuator.step(time, self.engine.account(*instant))
        self.time, self._instant = time, instant
        if at_step:
            if time == self.process.next_step:
                self._step_process()
            self.next_step = min(self.actuator.next_step, self.process.next_step)

    def advance_through(self, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Advance to times one after the other [ns], before the next step.

        Return how many segments and impacts since the last ``drain`` were finished at each time;
        None if it must be done one by one, and nothing has moved.
        """
        if self.actuator.resonance is not None or self._percussion is not None:
            return None  # each reading needs the account at its time, and each block its feed's
        self._push_to_engine()
        segments = sum(map(len, self._segments))
        impacts = sum(map(len, self._impacts))
        seconds, rest = np.divmod(ends, SECOND)
        reached = self.engine.advance_through(seconds, rest / SECOND)
        if reached is None:
            return None
        self.time = int(ends[-1])
        self._instant = split_fraction(self.time)
        finished, struck = reached.T
        return finished + segments, struck + impacts

    def check(self, motion: Motion) -> None:
        if (mount := self.process.mount) is not None:
            mount.check(motion)

    def move(self, motion: Motion) -> None:
        """Apply a motion of the mount; a step of the mount ends and one begins here.

        So what another simulator exchanges acts from its own instants on.
        """
        mount = self.process.mount
        if mount is None:
            return
        if isinstance(motion, MountMotion) and self.process.end_step(self.time):
            self._step_process()
            self.next_step = min(self.actuator.next_step, self.process.next_step)
        mount.set_motion(motion)
        self._look_ahead(mount)

    def _look_ahead(self, mount: Mount) -> None:
        process, rate = self.process, self._pushing_rate()
        mount.look_ahead(process.next_step, process.length, rate, self._drill.rpud_damping)
        if self._load_spring is not None:
            self._load_spring.lead(mount.advance)

    def change(self, effects: FaultEffects) -> None:
        """Apply effects of faults at the current time; positions and velocities continue."""
        self._set_aside()
        self.actuator.drift(effects.resonance_offset)
        self.actuator.lock(not effects.lock_lost)
        self._effects = effects
        if self.process.mount is not None:
            self.process.set_spring_stiffness(self._stiffness)
        self._drill = self._derived()

    def drain(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the segments that cover the time since the last call, and the impacts.

        The last segment is the open one; the first one was open at the last call.
        """
        covering, impacts = self._drain_engine()
        if self._segments:
            covering = join_records([*self._segments, covering], SEGMENT)
            impacts = join_records([*self._impacts, impacts], IMPACT)
            self._segments.clear()
            self._impacts.clear()
        return covering, impacts

    def _set_aside(self) -> None:
        """Keep what happened for the next ``drain``: impacts acted under the conditions so far."""
        covering, impacts = self._drain_engine()
        self._segments.append(join_records([covering[:-1]], SEGMENT))  # copies
        self._impacts.append(join_records([impacts], IMPACT))

    def _drain_engine(self) -> tuple[np.ndarray, np.ndarray]:
        covering, impacts = self.engine.drain()
        self._make_progress(impacts[self._counted :])
        self._counted = 0
        return covering, impacts

    def _step_process(self) -> None:
        engine = self.engine
        assert self._percussion is not None
        struck = engine.impacts_from(self._counted)
        if len(struck):
            self._counted += len(struck)
            self._make_progress(struck)
        position = nodal_plane_position(engine.open_segment, *self._instant)
        weight = self._weight_on_bit()
        percussion = self._percussion.read(
            self.process.length, position, weight, self._drill, engine.amplitude
        )
        mount = self.process.mount
        was_in_contact = mount is not None and mount.in_contact
        self.process.step(percussion, self._effects, self._pushing_rate(), self._bottom())
        if self._load_spring and mount is not None:
            if mount.in_contact is not was_in_contact:
                self._drill = self._derived()
            self._load_spring.step(mount.advance, self._pushing_rate(), position)
            self._passed = mount.advance.passed
            self._look_ahead(mount)
            feed = self.feed_account(engine.open_segment) if self.time % SECOND == 0 else None
            if feed is not None:
                self._check_coupling(feed.coupling, self._percussion.arrived)

    def _check_coupling(self, coupling: float, arrived: float) -> None:
        """Fail where the steps of the arm created more energy in a second than impacts brought."""
        created, brought = self._checked[0] - coupling, arrived - self._checked[1]
        self._checked = (coupling, arrived)
        if created > brought + LEAST_CREATED:
            raise EngineError(
                f"the arm is unstable: its steps created {created:.3g} J in the second before "
                f"{self.time / SECOND:g} s, impacts brought {brought:.3g} J; it needs a higher "
                "arm_stiffness, arm_damping or rpud_damping_ratio, or a lower load_spring_rate"
            )

    def _note_withdrawal(self) -> None:
        """Note that the origin of the bodies' displacements passes them by ``_passed``."""
        assert self._load_spring is not None
        assert self._percussion is not None
        segment = self.engine.open_segment[0]
        motion = motion_at(segment, self.engine.ahead(*self._instant))
        rate = self._drill.tool_spring_rate
        work = float(withdrawal_work(segment, rate, motion, self._passed))
        self._percussion.shift(self._passed)
        self._load_spring.shift(self._passed, work)

    def _pushing_rate(self) -> float:
        acting = self._effects
        return acting.pushing_rate * acting.preload_factor

    def _bottom(self) -> float:
        """Depth at which the tool meets rock, by percussion alone [m]; infinite without rock."""
        if self._effects.parameters.regime != "drilling":
            return math.inf
        depth = self.progress.depth
        return depth if math.isfinite(depth) else 0.0

    def _acting_parameters(self) -> Parameters:
        """Parameters active, free of the rock while the tool does not touch it."""
        parameters = self._effects.parameters
        mount = self.process.mount
        if mount is not None and not mount.in_contact and parameters.regime == "drilling":
            return parameters.replace(regime="free")
        return parameters

    def _derived(self) -> DrillConstants:
        return derive(self._acting_parameters(), self._effects.jammed)

    def feed_account(self, segment: np.ndarray) -> FeedAccount | None:
        if self._load_spring is None or (mount := self.process.state.mount) is None:
            return None
        position = nodal_plane_position(segment, *self._instant)
        return self._load_spring.account(mount.work, position)

    def _make_progress(self, impacts: np.ndarray) -> None:
        if self._percussion is not None:
            self._percussion.add(impacts)
        if self._drill.in_rock:
            acting = self._effects
            self.progress.add(impacts, acting.hardness, acting.progress_factor)

    def _weight_on_bit(self) -> float:
        if (mount := self.process.mount) is not None:
            return mount.preload
        return self.weight_on_bit * self._effects.preload_factor

    def _commands(self) -> tuple[tuple[float, float, float], float]:
        actuator = self.actuator
        resonance = 0.0 if actuator.resonance is None else actuator.resonance_frequency
        return (self._weight_on_bit(), actuator.level, actuator.frequency), resonance

    def _push_to_engine(self) -> None:
        """Push what has changed to the engine; no change leaves the trajectory as it is.

        It happens once for each instant, so that the order of changes there makes no difference.
        """
        in_force = (self._drill, *self._commands())
        fed = self._load_spring is not None
        if in_force != self._in_force or self._passed or (fed and self.engine.seats):
            self._in_force = in_force
            if self._passed:
                self._note_withdrawal()
            seconds, fraction = self._instant
            self.engine.change(seconds, fraction, *in_force, self._passed, fed)
            self._passed = 0.0
