"""LiveServer: serve a recording to viewers on this machine, or through SSH, while it is made."""

import socket

import rerun as rr

from srt3d_ros.errors import require
from srt3d_ros.recording import rerun_streams

ADDRESS = "127.0.0.1"       # loopback only: there is no password


class LiveServer:
    """A stream that is kept in memory and served to viewers; those that connect later get the past, too.

    Args:
        port: on the loopback interface.
        memory_mb: how much is kept; the oldest frames are discarded first.
        application_id, recording_id: as in the files.

    Raises:
        InvalidInput: if the port is taken.
    """

    def __init__(self, port: int, memory_mb: int, application_id: str, recording_id: str):
        check_free(port)
        self.stream = rr.RecordingStream(application_id, recording_id=recording_id)
        self.stream.set_sinks(rr.GrpcServerSink(ADDRESS, port, server_memory_limit=f"{memory_mb}MB"))

    def close(self) -> None:
        """Stop the server."""
        self.stream.disconnect()
        self.stream = None
        rerun_streams.free_ended()


def check_free(port: int) -> None:
    """Raise InvalidInput if something listens at the port already."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((ADDRESS, port))
        except OSError as e:
            require(False, "live_port", port, f"a port that is free ({e.strerror})")
