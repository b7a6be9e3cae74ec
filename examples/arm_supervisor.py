"""A supervisor of a drill on an arm: it commands feed and drive alone. Plain rclpy, to be copied.

It presses the drill on the rock by the feed of the arm, starts the hole gently, and drills with
the weight on bit that it is given. When the torque is too high or the progress too slow, it draws
the turning tool out of the hole to clear it, and then advances more gently until the progress is
good again. At its depth it draws the tool back and switches the drive off.

    python arm_supervisor.py --ros-args -r __ns:=/rpud -p depth:=0.05 -p weight:=20.0
"""

import enum

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import Borehole, Drive, Feed, Mount, Rotation

PERIOD = 50_000_000  # of the control, whose multiples it keeps [ns]

# Force control: rate of the feed = GAIN * e + RESET * integral of e, e the missing weight on bit.
# Load spring and arm in series are k = 1.8 kN/m, so GAIN * k = 5.5 rad/s: far below 1 / PERIOD.
GAIN = 3e-3  # [(m/s)/N]
RESET = 3e-3  # [(m/s)/(N s)]
FASTEST = 0.01  # rate of the feed under force control [m/s]

TRAVEL = 0.04  # rate of the feed in the empty hole, the drill's feed_rate_limit [m/s]
TOUCH = 0.005  # rate of the feed toward the rock [m/s]
MARGIN = 0.003  # distance to the bottom of the hole that it feeds with the rate TOUCH [m]
CONTACT = 3.0  # weight on bit at which the tool is on the rock [N]

START_WEIGHT = 8.0  # on bit until the hole guides the bit [N]
START_DEPTH = 0.003  # of such a hole [m]
GENTLE = 0.6  # share of the weight on bit after a disturbance

TORQUE = 0.06  # above which the hole is cleared [N m]; the rotor stalls at 0.1
SLOW = 0.8e-3  # rate of penetration below which the hole is cleared [m/s]
LOADED = 100_000_000  # of high torque before it is a reason [ns]
SETTLING = 1_200_000_000  # after which the rate of penetration is meaningful [ns]
TURNING = 300_000_000  # of the tool above the hole, to throw off the cuttings [ns]
ARM_FORCE = 80.0  # mean reacting force above which it gives up [N]
SMOOTHING = 0.1  # share of a new reading in that mean

VOLTAGE, FREQUENCY = 100.0, 16_000.0  # of the drive [V], [Hz]
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class State(enum.Enum):
    """What it does."""

    WAITING = "waiting"
    APPROACHING = "approaching"
    STARTING = "starting"
    DRILLING = "drilling"
    CLEARING = "clearing"
    RETURNING = "returning"
    ADVANCING = "advancing gently"
    LEAVING = "leaving"
    DONE = "done"


WITHOUT_DRIVE = (State.WAITING, State.APPROACHING, State.DONE)


class ArmSupervisor(Node):
    """Commands feed and drive once in every period, also when nothing changes.

    It decides when all four topics have reached a period. Should one of them fall silent, its
    commands stop, and the drill's ``command_timeout`` stops feed and drive.
    The state goes out on ``supervisor/state``, latched, with stamp and reason.
    """

    def __init__(self):
        super().__init__("arm_supervisor")
        self._depth = self.declare_parameter("depth", 0.05).value  # of the hole [m]
        self._weight = self.declare_parameter("weight", 20.0).value  # on bit [N]
        self._state = State.WAITING
        self._since = 0  # stamp of the last change of state [ns]
        self._turned_freely = 0  # stamp at which the torque was last low [ns]
        self._integral = 0.0  # part of the rate of the feed [m/s]
        self._arm_force = 0.0  # mean [N]
        self._home = 0.0  # position of the feed before the hole [m]
        self._began = 0  # stamp of the first period [ns]
        self._period = 0  # number of the last one
        self._latest = {}  # message of each topic
        self._states = self.create_publisher(DiagnosticArray, "supervisor/state", LATCHED)
        self._feeds = self.create_publisher(Feed, "command/feed", 10)
        self._drives = self.create_publisher(Drive, "command/drive", 10)
        heard = {
            "wrench": WrenchStamped,
            "rotation": Rotation,
            "mount": Mount,
            "borehole": Borehole,
        }
        for topic, kind in heard.items():
            self.create_subscription(kind, topic, self._listener(topic, len(heard)), 1000)
        self._search = self.create_timer(0.01, self._on_search)

    def _listener(self, topic, count):
        def hear(message):
            self._latest[topic] = message
            if len(self._latest) == count and self._state is not State.WAITING:
                now = min(nanoseconds(each.header.stamp) for each in self._latest.values())
                if now // PERIOD > self._period:
                    self._period = now // PERIOD
                    self._decide(now)

        return hear

    def _on_search(self):
        """Begin when the drill is there; nothing else follows the clock on the wall."""
        if all(each.get_subscription_count() for each in (self._drives, self._feeds)):
            self._search.cancel()
            self._change(State.APPROACHING, 0, "the drill is there")

    def _decide(self, now):
        """Change the state if there is a reason, and command."""
        mount = self._latest["mount"]
        if not self._began:
            self._began, self._home = now, mount.feed
        force = abs(self._latest["wrench"].wrench.force.z)
        self._arm_force += SMOOTHING * (force - self._arm_force)
        if self._arm_force > ARM_FORCE and self._state not in (State.LEAVING, State.DONE):
            self._change(State.LEAVING, now, f"{self._arm_force:.0f} N on the arm")
        rate = getattr(self, f"_{self._state.name.lower()}")(now)
        self._command(now, rate)

    # What each state does: change to another one, and return the rate of the feed [m/s].

    def _approaching(self, now):
        if self._latest["mount"].weight_on_bit > CONTACT:
            self._change(State.STARTING, now, "the tool is on the rock")
        return TOUCH

    def _starting(self, now):
        if self._latest["borehole"].depth > START_DEPTH:
            self._change(State.DRILLING, now, "the hole guides the bit")
        return self._press(START_WEIGHT)

    def _drilling(self, now):
        progress = self._latest["borehole"].penetration_rate
        if self._finished(now) or self._jammed(now):
            return 0.0
        if now - self._since > SETTLING and progress < SLOW:
            self._change(State.CLEARING, now, f"{6e4 * progress:.0f} mm/min is too slow")
        return self._press(self._weight)

    def _clearing(self, now):
        if self._latest["mount"].position > 0.0:
            self._since = now  # when it came out of the hole
            return -TRAVEL
        if now - self._since > TURNING:
            self._change(State.RETURNING, now, "the tool has turned above the hole")
        return 0.0

    def _returning(self, now):
        if self._latest["mount"].weight_on_bit > CONTACT:
            self._integral = 0.0
            self._change(State.ADVANCING, now, "the tool is on the rock again")
        near = self._latest["mount"].position > self._latest["borehole"].depth - MARGIN
        return TOUCH if near else TRAVEL

    def _advancing(self, now):
        progress = self._latest["borehole"].penetration_rate
        if self._finished(now) or self._jammed(now):
            return 0.0
        if now - self._since > SETTLING and progress > SLOW:
            self._change(State.DRILLING, now, f"{6e4 * progress:.0f} mm/min is good")
        return self._press(GENTLE * self._weight)

    def _leaving(self, now):
        if self._latest["mount"].feed > self._home:
            return -TRAVEL
        self._change(State.DONE, now, "the tool is out of the hole")
        return 0.0

    def _done(self, now):
        return 0.0

    def _finished(self, now):
        """Leave at the depth, and return whether it does."""
        depth = self._latest["borehole"].depth
        if depth >= self._depth:
            self._change(State.LEAVING, now, f"the hole is {1e3 * depth:.1f} mm deep")
        return depth >= self._depth

    def _jammed(self, now):
        """Clear the hole after too much torque for a while, and return whether it does."""
        rotation = self._latest["rotation"]
        if not (rotation.torque > TORQUE or rotation.stalled):
            self._turned_freely = now
        jammed = now - self._turned_freely > LOADED
        if jammed:
            self._change(State.CLEARING, now, f"{1e3 * rotation.torque:.0f} mN m is too much")
        return jammed

    def _press(self, weight):
        """Return the rate of the feed for a weight on bit, by a PI controller [m/s]."""
        missing = weight - self._latest["mount"].weight_on_bit
        self._integral += RESET * missing * PERIOD / 1e9
        self._integral = max(-FASTEST, min(self._integral, FASTEST))
        return max(-FASTEST, min(GAIN * missing + self._integral, FASTEST))

    def _command(self, now, rate):
        drive = Drive(enabled=self._state not in WITHOUT_DRIVE)
        if drive.enabled:
            drive.voltage, drive.frequency = VOLTAGE, FREQUENCY
        feed = Feed(mode=Feed.MODE_RATE, rate=rate)
        for publisher, command in ((self._drives, drive), (self._feeds, feed)):
            command.header.stamp = stamp(now)
            publisher.publish(command)

    def _change(self, state, now, reason):
        self._state = state
        self._since = self._turned_freely = now
        wrong = state is State.CLEARING
        status = DiagnosticStatus(name=state.value, message=reason)
        status.level = DiagnosticStatus.WARN if wrong else DiagnosticStatus.OK
        message = DiagnosticArray(status=[status])
        message.header.stamp = stamp(now)
        self._states.publish(message)
        after = (now - (self._began or now)) / 1e9
        self.get_logger().info(f"{state.value} after {after:.2f} s: {reason}")


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
        rclpy.spin(ArmSupervisor())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
