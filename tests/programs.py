"""Programs that tests start: their nodes, and where they listen."""

import psutil


def nodes_of(pid: int) -> dict[str, psutil.Process]:
    """The node processes that a program has started, by name."""
    found = {}
    for child in psutil.Process(pid).children(recursive=True):
        try:
            words = child.cmdline()
        except psutil.Error:        # it has just ended
            continue
        if "node" in words:
            found[words[words.index("node") + 1]] = child
    return found


def listening_at(port: int) -> set[str]:
    """Addresses at which somebody listens on a port."""
    return {one.laddr.ip for one in psutil.net_connections("tcp") if one.status == "LISTEN" and one.laddr.port == port}
