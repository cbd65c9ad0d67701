"""Release rerun's streams and their threads, which rerun 0.41 keeps until the process ends.

Otherwise a recorder would grow with each recording. Only this module uses private names of rerun. Remove it once
https://github.com/rerun-io/rerun/issues/2116 is solved.
"""

import rerun as rr
import rerun.blueprint as rrb
from rerun import bindings


def send_blueprint(stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
    """Send a blueprint as rerun.send_blueprint does, and release the stream that it was logged to."""
    made = rr.RecordingStream._from_native(bindings.new_blueprint(
        stream.get_application_id(), make_default=False, make_thread_default=False))
    made.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(made)
    bindings.send_blueprint(made.memory_recording().storage, True, True, recording=stream.to_native())
    made.disconnect()       # breaks the reference cycle of the stream and its memory


def free_ended() -> None:
    """Free streams that have ended and have no references."""
    bindings.flush_and_cleanup_orphaned_recordings()
