"""A supervisor of the drill, as a probe or a manipulator would carry it: plain rclpy, to be copied.

It engages the rock, ramps the weight on bit until the mean reacting force is what the arm shall
bear, holds it there, and retreats when the impacts stop under a running drive. Its only clock is
the stamps of the drill's messages, so that it behaves alike in real time and in steps.

    python supervisor.py --ros-args -r __ns:=/rpud -p target:=30.0
"""

import enum

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import ContactForce, Drive, ReactingForce, WeightOnBit
from std_srvs.srv import SetBool

PERIOD = 100_000_000  # of the control, whose multiples it keeps [ns]
SILENCE = 300_000_000  # without an impact, which is a jam [ns]; pauses reach 51 ms
GAIN = 0.2  # weight on bit per missing reacting force, in each period
LARGEST_STEP = 2.0  # of the weight on bit in a period [N]
GREATEST_WEIGHT = 100.0  # on bit [N]
TOLERANCE = 2.0  # of the reacting force that counts as reached [N]
VOLTAGE, FREQUENCY = 100.0, 16_000.0  # of the drive [V], [Hz]

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class State(enum.Enum):
    """What it does."""

    WAITING = "waiting"
    ENGAGING = "engaging"
    RAMPING = "ramping"
    DRILLING = "drilling"
    RETREATING = "retreating"
    RETREATED = "retreated"


class Supervisor(Node):
    """Commands the drill once in every period, also when nothing changes.

    The drill's ``command_timeout`` wants it so: should this node die, the drill makes itself safe.
    The state goes out on ``supervisor/state``, latched, with stamp and reason.
    """

    def __init__(self):
        super().__init__("supervisor")
        self._target = self.declare_parameter("target", 35.0).value  # mean reacting force [N]
        self._state = State.WAITING
        self._weight = 0.0  # on bit [N]
        self._forces = []  # since the last command [N]
        self._commanded = None  # stamp of the last command, at first of the first sample [ns]
        self._struck = 0  # stamp of the last impact, at first that of the start [ns]
        self._states = self.create_publisher(DiagnosticArray, "supervisor/state", LATCHED)
        self._weights = self.create_publisher(WeightOnBit, "command/weight_on_bit", 10)
        self._drives = self.create_publisher(Drive, "command/drive", 10)
        self.create_subscription(ReactingForce, "reacting_force", self._on_force, 1000)
        self.create_subscription(ContactForce, "contact_force", self._on_impact, 1)  # the last
        # Made last: when the drill answers, it has met all that was made before.
        self._engage = self.create_client(SetBool, "engage")
        self._search = self.create_timer(0.05, self._on_search)

    def _on_search(self):
        """Begin when the drill is there; nothing else follows the clock on the wall."""
        publishers = (self._drives, self._weights)
        if all(each.get_subscription_count() for each in publishers):
            if not self._engage.service_is_ready():
                return
            self._search.cancel()
            self._change(State.ENGAGING, 0, "the drill is there")
            self._request(True, State.RAMPING, 0)

    def _on_impact(self, message):
        self._struck = nanoseconds(message.header.stamp)

    def _on_force(self, message):
        """Take a sample of the reacting force; with its stamp, time goes on."""
        now = nanoseconds(message.header.stamp)
        if self._state is State.WAITING or self._state is State.ENGAGING:
            return
        if self._commanded is None:
            self._commanded = self._struck = now
        self._forces.append(message.force)
        if now // PERIOD > self._commanded // PERIOD:
            self._commanded = now
            self._control(now, sum(self._forces) / len(self._forces))
            self._forces.clear()

    def _control(self, now, mean_force):
        """Decide what to command, once in every period."""
        if self._state is State.RETREATING:  # drive and weight on bit have been off for a period
            self._request(False, State.RETREATED, now)
            return
        if self._state is not State.RETREATED:
            if now - self._struck > SILENCE:
                self._weight = 0.0
                self._change(State.RETREATING, now, "no impacts under a running drive: jammed")
            else:
                self._ramp(now, mean_force)
        self._command(now)

    def _ramp(self, now, mean_force):
        """Integrate toward the target, not faster than the arm shall feel it."""
        missing = self._target - mean_force
        step = max(-LARGEST_STEP, min(GAIN * missing, LARGEST_STEP))
        self._weight = max(0.0, min(self._weight + step, GREATEST_WEIGHT))
        if self._state is State.RAMPING and missing < TOLERANCE:
            self._change(State.DRILLING, now, f"reacting force is {mean_force:.1f} N")

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
            answer = future.result()
            where = "in" if engaged else "out of"
            if answer.success:
                self._change(then, now, f"the drill tool is {where} the rock")
            else:
                self._change(State.RETREATED, now, f"refused: {answer.message}")
            if not engaged:
                self._command(now)

        self._engage.call_async(SetBool.Request(data=engaged)).add_done_callback(answered)

    def _change(self, state, now, reason):
        self._state = state
        jammed = state is State.RETREATING
        status = DiagnosticStatus(name=state.value, message=reason)
        status.level = DiagnosticStatus.ERROR if jammed else DiagnosticStatus.OK
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
        rclpy.spin(Supervisor())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
