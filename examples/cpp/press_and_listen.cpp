// Commands a weight on bit and prints the mean reacting force of each second.
//
// Topics, relative to the namespace of the drill: publishes command/weight_on_bit, subscribes to
// reacting_force and command_results. Parameter: force [N], 20 by default.

#include <memory>

#include <rclcpp/rclcpp.hpp>
#include <rpud_msgs/msg/command_results.hpp>
#include <rpud_msgs/msg/reacting_force.hpp>
#include <rpud_msgs/msg/weight_on_bit.hpp>
#include <std_msgs/msg/header.hpp>

using rpud_msgs::msg::CommandResults;
using rpud_msgs::msg::ReactingForce;
using rpud_msgs::msg::WeightOnBit;

class PressAndListen : public rclcpp::Node
{
public:
  PressAndListen()
  : Node("press_and_listen", "rpud"), weight_(declare_parameter("force", 20.0))
  {
    // command_results echoes the header. The results of earlier commands are latched: the name tells ours
    // from a command without a header, the stamp from one of an earlier process with the same name.
    header_.frame_id = get_name();
    command_ = create_publisher<WeightOnBit>("command/weight_on_bit", 10);
    results_ = create_subscription<CommandResults>(
      "command_results", rclcpp::QoS(100).transient_local(),
      [this](const CommandResults & message) {hear(message);});
    force_ = create_subscription<ReactingForce>(
      "reacting_force", 1000, [this](const ReactingForce & message) {hear(message);});
    // A message is lost if nobody has discovered its publisher yet.
    timer_ = create_wall_timer(std::chrono::milliseconds(100), [this]() {press();});
  }

private:
  void press()
  {
    if (command_->get_subscription_count() == 0) {
      return;
    }
    timer_->cancel();
    header_.stamp = now();
    WeightOnBit message;
    message.header = header_;
    message.force = weight_;
    command_->publish(message);
  }

  void hear(const CommandResults & message)
  {
    for (const auto & result : message.results) {
      if (result.header != header_) {
        continue;  // the command of somebody else, or an earlier one
      }
      if (result.accepted) {
        RCLCPP_INFO(get_logger(), "the drill presses with %.1f N", weight_);
      } else {
        RCLCPP_ERROR(get_logger(), "rejected: %s", result.reason.c_str());
      }
    }
  }

  void hear(const ReactingForce & message)
  {
    sum_ += message.force;
    ++count_;
    if (message.header.stamp.sec != second_) {
      RCLCPP_INFO(get_logger(), "reacting force %.1f N", sum_ / count_);
      second_ = message.header.stamp.sec;
      sum_ = 0.0;
      count_ = 0;
    }
  }

  double weight_;  // on bit [N]
  std_msgs::msg::Header header_;  // of the command
  double sum_ = 0.0;  // of the forces of this second [N]
  int count_ = 0;
  int second_ = 0;  // of the stamp
  rclcpp::Publisher<WeightOnBit>::SharedPtr command_;
  rclcpp::Subscription<CommandResults>::SharedPtr results_;
  rclcpp::Subscription<ReactingForce>::SharedPtr force_;
  rclcpp::TimerBase::SharedPtr timer_;
};

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<PressAndListen>());
  rclcpp::shutdown();
  return 0;
}
