"""The broker that falls silent for a while stops no worker."""

import os
import signal
from collections.abc import Callable, Iterator

import pytest
from kombu import Connection, Consumer, Message, Queue
from redis import RedisError

from tests.support.broker import Broker
from workers.transport import Transport

_SILENCE_S = 0.3


@pytest.fixture
def connection(broker: Broker) -> Iterator[Connection]:
    with Connection(broker.url, transport_options={"socket_timeout": _SILENCE_S}) as made:
        made.transport_cls = Transport
        yield made


@pytest.mark.parametrize("answer", [Message.ack, Message.reject, Message.requeue])
def test_a_message_that_could_not_be_answered_does_not_count_as_work_in_hand(
    connection: Connection, broker: Broker, answer: Callable[[Message], None]
) -> None:
    queue = Queue("sweep", routing_key="sweep")
    received: list[Message] = []
    with connection.SimpleQueue(queue) as sending:
        for number in range(2):
            sending.put(number)
    with Consumer(connection, [queue], on_message=received.append, prefetch_count=1):
        connection.drain_events(timeout=60)
        os.kill(broker.child.pid, signal.SIGSTOP)
        try:
            with pytest.raises(RedisError):
                answer(received[0])
        finally:
            os.kill(broker.child.pid, signal.SIGCONT)
        connection.drain_events(timeout=60)
    assert len(received) == 2
