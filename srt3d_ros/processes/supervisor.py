"""Runs several nodes as one program: starts, watches, restarts and stops them in order."""

import signal
import sys
import time

from srt3d_ros.errors import BAD_INPUT
from srt3d_ros.processes import children
from srt3d_ros.processes.node_command import FRAMES_LOST, PLAYER, RECORDER, node_command

POLL_CHILDREN_S = 0.05           # longest time until a signal or the end of a node is noticed
MOST_RESTARTS, BUDGET_S = 5, 60.0   # restarts of a node in any such time; of a player, which begins again, in all
RESTART_DELAY_S = 1.0
HAND_OVER_S = 0.3       # for a node's last messages to reach the next node before that ends, too
SIGNALLED = 128         # plus the signal's number: a shell's exit code for a process ended by a signal
# What follows the end of a node.
RESTART = f"starting it again, at most {MOST_RESTARTS} times in {BUDGET_S:.0f} s"
GIVE_UP = "given up, nothing is recorded; points go on"
END = "stopping all nodes"


class Restarts:
    """Decides what follows the end of a node.

    Args:
        names: all nodes.
    """

    def __init__(self, names: list[str]):
        self._with_player = PLAYER in names
        self._restarted_s: dict[str, list[float]] = {}      # the last restarts of each node

    def after(self, name: str, code: int) -> str:
        """RESTART, GIVE_UP or END after this node has ended with this exit code; negative: by this signal."""
        now_s = time.monotonic()
        restarted_s = [then_s for then_s in self._restarted_s.get(name, ())
                       if name == PLAYER or now_s - then_s < BUDGET_S]
        hopeless = code == BAD_INPUT or (name == PLAYER and code in (0, FRAMES_LOST))     # a restart would not help
        if not hopeless and len(restarted_s) < MOST_RESTARTS:
            self._restarted_s[name] = [*restarted_s, now_s]
            return RESTART
        # A player waits for the recorder; with bad input it never comes.
        return GIVE_UP if name == RECORDER and not (hopeless and self._with_player) else END


def supervise(names: list[str], ros_args: list[str]) -> int:
    """Run nodes until SIGINT, SIGTERM or SIGHUP, or until the end of one ends all (Restarts).

    Args:
        names: the nodes, subscribers first; they are stopped in the reverse order.
        ros_args: arguments for ROS 2, the same for all nodes.

    Returns:
        0, or the exit code of the node that ended all, or else of a recorder that failed.
    """
    signals, codes, restarts, step, gap = [], [], Restarts(names), "", ""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, frame: signals.append(number))
    nodes = {name: children.start(node_command(name, *ros_args)) for name in names}
    while not signals and step != END:
        time.sleep(POLL_CHILDREN_S)
        ended = next((name for name, node in nodes.items() if node.poll() is not None), None)
        if ended is None or signals:
            continue
        step, code = restarts.after(ended, nodes[ended].returncode), shell_code(nodes[ended].returncode)
        _say(f"{'ERROR: ' * (step == GIVE_UP)}{ended} {children.ending(nodes[ended])}: {step}")
        if step == END or ended == RECORDER:
            codes.insert(0, code or int(step == END and ended != PLAYER))
        if ended == RECORDER and step != END:
            gap = f"recorder {children.ending(nodes[ended])}: the recording is not complete"
        if step == GIVE_UP:
            del nodes[ended]
        elif step == RESTART:
            time.sleep(RESTART_DELAY_S)
            if not signals:
                nodes[ended] = children.start(node_command(ended, *ros_args))
    for node in reversed(nodes.values()):
        if node.poll() is None:
            children.stop(node)
            time.sleep(HAND_OVER_S)
    codes += [shell_code(node.returncode) for node in nodes.values()]
    if step == END and codes[0] == FRAMES_LOST:
        _say("frames were lost; see the player's last line")
    if gap:
        _say(gap)
    return next(filter(None, codes), 0)


def shell_code(code: int) -> int:
    """A shell's exit code for that of a process; 0 if a signal asked it to end before it had started."""
    if code in (-signal.SIGINT, -signal.SIGTERM):
        return 0
    return SIGNALLED - code if code < 0 else code


def _say(text: str) -> None:
    print(f"srt3d up: {text}", file=sys.stderr, flush=True)
