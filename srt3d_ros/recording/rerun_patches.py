"""What rerun 0.41 does not do by itself: each function says when it can go.

Only this module uses private names of rerun.
"""

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb
from rerun import bindings


def create_file(path: Path) -> None:
    """Create a stream's file, or raise OSError; the stream's header overwrites the byte.

    Until `RecordingStream.save` raises: rerun 0.41 would wait for ever.
    """
    with path.open("xb") as file:
        file.write(b"R")


def send_blueprint(stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
    """Send a blueprint as rerun.send_blueprint does, and release the stream that it was logged to.

    Until https://github.com/rerun-io/rerun/issues/2116 is solved: rerun 0.41 keeps streams and their threads until the
    process ends, and a recorder would grow with each recording.
    """
    made = rr.RecordingStream._from_native(bindings.new_blueprint(
        stream.get_application_id(), make_default=False, make_thread_default=False))
    made.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(made)
    bindings.send_blueprint(made.memory_recording().storage, True, True, recording=stream.to_native())
    made.disconnect()       # breaks the reference cycle of the stream and its memory


def free_ended() -> None:
    """Free streams that have ended and have no references. Until the same issue is solved."""
    bindings.flush_and_cleanup_orphaned_recordings()
