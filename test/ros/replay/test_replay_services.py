"""A request that raises an error is answered and counted, and the next one served."""

import rclpy
from rclpy.executors import SingleThreadedExecutor
from sample_bags import write_bag
from std_srvs.srv import Trigger
from support import PATIENCE

import rpud_sim.bag
from rpud_sim.ros.graph import rosbag_service
from rpud_sim.ros.replay.playback import Plan, Playback, ReadAhead
from rpud_sim.ros.replay.replayer import PlaybackThread, offer_services
from rpud_sim.ros.replay.replayer_node import Replayer


def test_a_request_that_raises_an_error_is_answered_and_counted(tmp_path, capfd):
    rclpy.init()
    executor = SingleThreadedExecutor()
    with rpud_sim.bag.open(write_bag(tmp_path / "run")) as bag:
        node = Replayer(bag.topics, with_clock=False)
        plan = Plan(bag.start_time, bag.end_time, rate=1.0, paused=True, loop=False, tick=None)
        thread = PlaybackThread(
            Playback(lambda position: ReadAhead(bag.messages(node.topic_names)), plan, node)
        )
        offer_services(node, thread)
        thread.start()
        executor.add_node(node)

        def ask(name):
            client = node.create_client(rosbag_service(name), f"~/{name}")
            assert client.wait_for_service(PATIENCE)
            future = client.call_async(rosbag_service(name).Request())
            executor.spin_until_future_complete(future, PATIENCE)
            return future.result()

        try:
            for publisher in list(node.publishers):
                node.destroy_publisher(publisher)  # publishing raises an error from now on
            response = ask("play_next")
            assert not response.success
            if isinstance(response, Trigger.Response):
                assert response.message.startswith("it raised RCLError")
            assert node.failures == 1
            assert "request failed: play_next: it raised RCLError" in capfd.readouterr().err
            assert ask("is_paused").paused
        finally:
            thread.stop()
            thread.join()
            executor.shutdown()
            node.destroy_node()
            rclpy.try_shutdown()
