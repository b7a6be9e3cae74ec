"""A supervisor of the drill, as a probe or a manipulator would carry it: plain rclpy, to be copied.

It puts the drill tool into the rock, ramps the weight on bit until the mean reacting force is what
the arm may bear, and holds it there. It retreats when the impacts stop under a running drive, and
when it cannot trust the force sensor. Its only clock is the stamps of the wrist sensor's messages,
so that it behaves alike in real time and in steps.

    python supervisor.py --ros-args -r __ns:=/rpud -p target:=30.0
"""

import collections
import enum
import math

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from rpud_msgs.msg import ContactForce, Drive, ReactingForce, Status, WeightOnBit
from std_srvs.srv import Empty, SetBool

PERIOD = 100_000_000  # of the control, whose multiples it keeps [ns]
LATENCY = 20_000_000  # that a reading may need to arrive [ns]
SILENCE = 300_000_000  # without an impact, which is a jam [ns]; pauses reach some 50 ms
BLINDNESS = 200_000_000  # without a trusted reading, after which it retreats [ns]
GAIN = 0.2  # weight on bit per missing reacting force, in each period
LARGEST_STEP = 2.0  # of the weight on bit in a period [N]
GREATEST_WEIGHT = 40.0  # on bit [N]
GREATEST_FORCE = 500.0  # that the force sensor can measure [N]
TOLERANCE = 2.0  # of the reacting force that counts as reached [N]
VOLTAGE, FREQUENCY = 100.0, 16_000.0  # of the drive [V], [Hz]

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class State(enum.Enum):
    """What it does."""

    WAITING = "waiting"
    READY = "ready"
    RAMPING = "ramping"
    DRILLING = "drilling"
    RETREATING = "retreating"
    RETREATED = "retreated"


class Supervisor(Node):
    """Commands the drill once in every period, also when nothing changes.

    The drill's ``command_timeout`` needs it: if this node dies, the drill goes to zero by itself.
    A command has the stamp of the period that it answers. It goes out when all is done that the
    supervisor does in this period, the answer of a service included.
    The state goes out on ``supervisor/state``, latched, with stamp and reason.
    """

    def __init__(self):
        super().__init__("supervisor")
        self._target = self.declare_parameter("target", 35.0).value  # mean reacting force [N]
        self._state = State.WAITING
        self._weight = 0.0  # on bit [N]
        self._readings = collections.deque()  # of the reacting force: stamp [ns], force [N]
        self._period = 0  # number of the last one
        self._struck = 0  # stamp of the last impact [ns]
        self._trusted = 0  # end of the last period in which the force sensor could be trusted [ns]
        self._driven = math.inf  # stamp at which the drive began to run, if it does [ns]
        self._asking = False  # whether the answer of a service is missing
        self._states = self.create_publisher(DiagnosticArray, "supervisor/state", LATCHED)
        self._weights = self.create_publisher(WeightOnBit, "command/weight_on_bit", 10)
        self._drives = self.create_publisher(Drive, "command/drive", 10)
        # The clock comes last: an executor looks at subscriptions in the order of their creation.
        self.create_subscription(Status, "status", self._on_status, LATCHED)
        # The latest impact alone: of a deep queue the executor would take old ones first.
        self.create_subscription(ContactForce, "contact_force", self._on_impact, 1)
        self.create_subscription(ReactingForce, "reacting_force", self._on_reading, 1000)
        self.create_subscription(WrenchStamped, "wrench", self._on_clock, 1000)
        self._engage = self.create_client(SetBool, "engage")
        self.over = Future()  # done at a call of supervisor/leave: its tests keep the process
        self.create_service(Empty, "supervisor/leave", self._on_leave)
        self._search = self.create_timer(0.01, self._on_search)

    def _on_leave(self, request, response):
        self.over.set_result(None)
        return response

    def _on_search(self):
        """Begin when the drill is there; nothing else follows the clock on the wall."""
        heard = all(each.get_subscription_count() for each in (self._drives, self._weights))
        if heard and self._engage.service_is_ready():
            self._search.cancel()
            self._change(State.READY, 0, "the drill is there")

    def _on_status(self, message):
        running = message.drive_enabled
        self._driven = nanoseconds(message.drive_applied) if running else math.inf

    def _on_impact(self, message):
        self._struck = nanoseconds(message.header.stamp)

    def _on_reading(self, message):
        self._readings.append((nanoseconds(message.header.stamp), message.force))

    def _on_clock(self, message):
        """Decide once in every period; a message is late rather than lost."""
        now = nanoseconds(message.header.stamp)
        period = now // PERIOD
        if self._state is not State.WAITING and not self._asking and period > self._period:
            self._period = period
            self._decide(now)

    def _decide(self, now):
        """Do what a period asks for, and command in the end."""
        force = self._mean_force(now)
        if self._state is State.READY:
            self._request(True, State.RAMPING, now)
        elif self._state is State.RETREATING:  # drive and weight on bit were off for a period
            self._request(False, State.RETREATED, now)
        else:
            if self._state is not State.RETREATED:
                self._drill(now, force)
            self._command(now)

    def _drill(self, now, force):
        """Retreat if there is a reason, or continue: without a running drive there is no reason."""
        if now - max(self._struck, self._driven) > SILENCE:
            self._retreat(now, "no impacts under a running drive: jammed")
        elif now - max(self._trusted, self._driven) >= BLINDNESS:
            self._retreat(now, "the force sensor cannot be trusted")
        elif force is not None:
            self._ramp(now, force)

    def _mean_force(self, now):
        """Return the mean of a period's readings [N], None if they cannot be trusted."""
        end = now - LATENCY
        forces = []
        while self._readings and self._readings[0][0] <= end:
            taken, force = self._readings.popleft()
            if taken > end - PERIOD:
                forces.append(force)
        if not all(abs(force) <= GREATEST_FORCE for force in forces):  # nor is NaN
            return None
        if len(set(forces)) < 2:  # nothing has come, or a sensor hangs: a drill is never at rest
            return None
        self._trusted = now
        return math.fsum(forces) / len(forces)

    def _ramp(self, now, force):
        """Integrate toward the target, in steps that are small enough for the arm."""
        missing = self._target - force
        step = max(-LARGEST_STEP, min(GAIN * missing, LARGEST_STEP))
        self._weight = max(0.0, min(self._weight + step, GREATEST_WEIGHT))
        if self._state is State.RAMPING and missing < TOLERANCE:
            self._change(State.DRILLING, now, f"reacting force is {force:.1f} N")

    def _retreat(self, now, reason):
        self._weight = 0.0
        self._change(State.RETREATING, now, reason)

    def _command(self, now):
        driven = self._state in (State.RAMPING, State.DRILLING)
        drive = Drive(enabled=driven)
        if driven:
            drive.voltage, drive.frequency = VOLTAGE, FREQUENCY
        weight_on_bit = WeightOnBit(force=self._weight)
        for publisher, command in ((self._drives, drive), (self._weights, weight_on_bit)):
            command.header.stamp = stamp(now)
            publisher.publish(command)

    def _request(self, engaged, then, now):
        """Put the drill tool into the rock or take it out, and change state when that is done."""

        def answered(future):
            self._asking = False
            answer = future.result()
            where = "in" if engaged else "out of"
            if answer.success:
                self._struck = self._trusted = now
                self._change(then, now, f"the drill tool is {where} the rock")
            else:
                self._change(State.RETREATED, now, f"rejected: {answer.message}")
            self._command(now)

        self._asking = True
        self._engage.call_async(SetBool.Request(data=engaged)).add_done_callback(answered)

    def _change(self, state, now, reason):
        self._state = state
        wrong = state is State.RETREATING
        status = DiagnosticStatus(name=state.value, message=reason)
        status.level = DiagnosticStatus.ERROR if wrong else DiagnosticStatus.OK
        message = DiagnosticArray(status=[status])
        message.header.stamp = stamp(now)
        self._states.publish(message)
        self.get_logger().info(f"{state.value}: {reason}")


def nanoseconds(time):
    """Convert a stamp to integer nanoseconds."""
    return time.sec * 1_000_000_000 + time.nanosec


def stamp(nanoseconds):
    """Convert integer nanoseconds to a stamp."""
    return rclpy.time.Time(nanoseconds=nanoseconds).to_msg()


def main():
    """Supervise until SIGINT or SIGTERM."""
    try:
        rclpy.init()
        while True:
            supervisor = Supervisor()
            rclpy.spin_until_future_complete(supervisor, supervisor.over)
            supervisor.destroy_node()
            input()  # a line begins the next run
    except (EOFError, KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
