"""rerun's streams, and how nothing of them stays: 0.41 keeps each, with its threads, until the process ends.

A recorder that begins a file every few minutes would grow for ever.
"""

import rerun as rr
import rerun.blueprint as rrb
from rerun import bindings

given_up: set = set()       # those whose streams may never end, as their disks hang


def send_blueprint(stream: rr.RecordingStream, blueprint: rrb.Blueprint) -> None:
    """As rerun's function of this name, which leaves the stream behind that it makes the layout in."""
    made = rr.RecordingStream._from_native(bindings.new_blueprint(
        stream.get_application_id(), make_default=False, make_thread_default=False))
    made.set_time("blueprint", sequence=0)
    blueprint._log_to_stream(made)
    bindings.send_blueprint(made.memory_recording().storage, True, True, recording=stream.to_native())
    made.disconnect()       # it holds its memory, which holds it


def let_go() -> None:
    """Give back what rerun keeps of streams that have ended and that nobody has any more."""
    if not given_up:        # rerun waits for all streams first
        bindings.flush_and_cleanup_orphaned_recordings()
