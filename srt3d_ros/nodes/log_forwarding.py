"""What the library says in Python's log, said in a node's: on /rosout, where who runs the node looks."""

import logging

LIBRARY = logging.getLogger("srt3d_ros")


class LogForwarding(logging.Handler):
    """Relays until it is closed. A node has a process of its own, so that it says all that is logged there.

    Args:
        logger: the node's.
    """

    def __init__(self, logger):
        super().__init__(logging.INFO)
        self._logger = logger
        LIBRARY.setLevel(logging.INFO)
        LIBRARY.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Say it; rclpy wants each severity to come from a line of its own."""
        if record.levelno >= logging.WARNING:
            self._logger.warning(record.getMessage())
        else:
            self._logger.info(record.getMessage())

    def close(self) -> None:
        """Say no more."""
        LIBRARY.removeHandler(self)
        super().close()
