"""The drawn order among topics."""

from rpud_sim.ros.drill.drawn_order import ShuffledOrder

RATE, PERIOD = 100, 10_000_000  # Hz, ns
TOPICS = ("contact_force", "journal", "reacting_force", "wrench")
# Ten periods, with two messages of each topic in each: the second at the end of the period.
MESSAGES = [
    (number * PERIOD - early, topic, bytes([number, early]))
    for number in range(1, 11)
    for early in (1, 0)
    for topic in TOPICS
]


def published(seed):
    return [message for _, part in ShuffledOrder(seed, RATE).parts(MESSAGES) for message in part]


def test_a_seed_draws_the_order_of_topics_in_each_period_and_keeps_the_order_within_a_topic():
    assert published(7) == published(7) != published(8)
    messages = published(7)
    assert sorted(messages) == sorted(MESSAGES)
    for name in TOPICS:
        of_topic = [message for message in messages if message[1] == name]
        assert of_topic == [message for message in MESSAGES if message[1] == name]
    for number in range(10):  # no message leaves its period
        found = [topic for _, topic, _ in messages[8 * number : 8 * number + 8 : 2]]
        assert found == ShuffledOrder(7, RATE).order((number + 1) * PERIOD, TOPICS)
        assert found[0] == "journal"
    orders = {tuple(ShuffledOrder(7, RATE).order(n * PERIOD, TOPICS)) for n in range(1, 11)}
    assert len(orders) > 2


def test_some_topics_are_paused_before_for_milliseconds():
    pauses = {pause for pause, _ in ShuffledOrder(7, RATE).parts(MESSAGES)}
    assert pauses == {0.0, 0.002, 0.005}
