"""Subscription: the messages of a device's ZeroMQ publisher, and when it goes away and comes back."""

from srt3d_ros.errors import InvalidInput

CONNECTED, GONE = "connected", "gone"
HEARTBEAT_MS, LOST_MS = 1000, 3000      # a device without power closes no connection: silence for so long does
WAITING = 4                             # messages that may wait; older ones are of no use
LONGEST = 2**24                         # bytes of a message; 48 × 32 zones with all frames are 0.4 MB


class Subscription:
    """What comes from an address, from any number of connections after each other. Use it in one thread.

    Raises:
        InvalidInput: no address of a publisher.
        ModuleNotFoundError: pyzmq is not installed.
    """

    def __init__(self, address: str):
        import zmq
        from zmq.utils.monitor import recv_monitor_message

        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        for option, value in ((zmq.SUBSCRIBE, b""), (zmq.RCVHWM, WAITING), (zmq.MAXMSGSIZE, LONGEST), (zmq.LINGER, 0),
                              (zmq.HEARTBEAT_IVL, HEARTBEAT_MS), (zmq.HEARTBEAT_TIMEOUT, LOST_MS)):
            self._socket.setsockopt(option, value)
        self._events = self._socket.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED)
        self._event = lambda: recv_monitor_message(self._events)["event"]
        self._names = {zmq.EVENT_HANDSHAKE_SUCCEEDED: CONNECTED, zmq.EVENT_DISCONNECTED: GONE}
        self._poller = zmq.Poller()
        for socket in (self._events, self._socket):
            self._poller.register(socket, zmq.POLLIN)
        try:
            self._socket.connect(address)
        except zmq.ZMQError:
            self.close()
            raise InvalidInput("connect", address, "the address of a publisher, such as tcp://169.254.0.2:5558") \
                from None

    def next(self, timeout_s: float) -> bytes | str | None:
        """A message, CONNECTED or GONE, or None after the timeout; GONE after all messages that came before."""
        ready = dict(self._poller.poll(timeout_s * 1e3))
        if self._socket in ready:
            return b"".join(self._socket.recv_multipart())
        return self._names[self._event()] if self._events in ready else None

    def close(self) -> None:
        """Leave."""
        self._socket.disable_monitor()
        self._events.close(0)
        self._socket.close()
        self._context.term()
