"""Serve a recording to viewers on this machine, or through SSH, while it is made."""

import socket

import rerun as rr

from srt3d_ros.errors import require

ADDRESS = "127.0.0.1"       # loopback only: there is no password
MEMORY = "256MB"            # of the newest frames, for viewers that connect later: a quarter of a minute at 16 MB/s


def serve(port: int, application_id: str, recording_id: str) -> rr.RecordingStream:
    """A stream to viewers, ids as in the files; those that connect later get the past as far as the memory keeps it.

    Raises:
        InvalidInput: if the port is taken.
    """
    check_free(port)
    stream = rr.RecordingStream(application_id, recording_id=recording_id)
    stream.set_sinks(rr.GrpcServerSink(ADDRESS, port, server_memory_limit=MEMORY))
    return stream


def check_free(port: int) -> None:
    """Raise InvalidInput if something listens at the port already."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((ADDRESS, port))
        except OSError as e:
            require(False, "live_port", port, f"a port that is free ({e.strerror})")
