"""Release rerun's streams, which rerun 0.41 keeps, each with its threads, until the process ends.

Otherwise a recorder that begins a recording now and then would grow forever. This is the only module that uses private
names of rerun. It can go once https://github.com/rerun-io/rerun/issues/2116 is solved.
"""

import rerun as rr
import rerun.blueprint as rrb
from rerun import bindings


def send_blueprint(stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
    """Like rerun's function of this name, which does not release the stream that it logs the blueprint to."""
    made = rr.RecordingStream._from_native(bindings.new_blueprint(
        stream.get_application_id(), make_default=False, make_thread_default=False))
    made.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(made)
    bindings.send_blueprint(made.memory_recording().storage, True, True, recording=stream.to_native())
    made.disconnect()       # the stream and its memory refer to each other


def free_ended() -> None:
    """Free the streams that have ended and are not referred to."""
    bindings.flush_and_cleanup_orphaned_recordings()
