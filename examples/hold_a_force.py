"""Hold a force by the feed, with the messages that ros2_control exchanges with the drill.

The controller is what `feed_force_controller` of config/ros2_control/controllers.yaml does: the
rate of the feed is a gain times the force error. It steps the drill, so that its result is the
same on any machine. Start the drill before: `rpud run --set feed_model=arm`.
"""

from sensor_msgs.msg import JointState

from rpud_sim.ros.client import DrillClient

FORCE = 30.0  # N
GAIN = 5e-4  # (m/s)/N
LIMIT = 5e-3  # feed_rate_limit of the drill [m/s]
PERIOD = 0.02  # s

with DrillClient(patience=60.0) as drill:
    drill.pause()
    states = drill.listen("joint_states")
    commands = drill.node.create_publisher(JointState, "joint_commands", 10)
    drill.until(commands.get_subscription_count)
    drill.step(PERIOD)
    efforts = []
    for _ in range(300):
        feed = states[-1].name.index("rpud_feed")
        efforts.append(states[-1].effort[feed])
        rate = max(-LIMIT, min(LIMIT, GAIN * (FORCE - efforts[-1])))
        accepted = drill.status.commands_accepted
        commands.publish(JointState(name=["rpud_feed"], velocity=[rate]))
        drill.until(lambda count=accepted: drill.status.commands_accepted > count)
        drill.step(PERIOD)
    print(f"feed: {1e3 * states[-1].position[feed]:.1f} mm")
    print(f"mean force of the last second: {sum(efforts[-50:]) / 50:.1f} N")
