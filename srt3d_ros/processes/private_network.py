"""A ROS domain of a program's own, so that programs on one machine do not hear each other."""

import os
import random
import signal
import socket

FIRST_PORT, PORTS = 7400, 250       # of domain 0, and those that DDS reserves for each (RTPS 2.5, 9.6.2.3)
USED_PORT = 10                      # of these, bound by the first program in a domain
MOST = 100                          # the highest domain whose ports no operating system hands out by itself

_claims: list[socket.socket] = []       # open as long as this process lives


def claim_domain() -> int:
    """A ROS domain, 1 to MOST, that no program on this machine uses or has claimed; kept until this process ends.

    The claim is the domain's last UDP port, bound and never read. Raises OSError where none is free.
    """
    for domain in random.SystemRandom().sample(range(1, MOST + 1), MOST):
        first_port = FIRST_PORT + PORTS * domain
        claim = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            claim.bind(("", first_port + PORTS - 1))
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as discovery:
                discovery.bind(("", first_port + USED_PORT))
        except OSError:
            claim.close()
        else:
            _claims.append(claim)
            return domain
    raise OSError(f"every ROS domain from 1 to {MOST} is in use on this machine")


def join_private_network() -> None:
    """Keep to this machine and clear of any other ROS 2 on it. The nodes inherit it; set before rclpy is imported.

    SIGTERM and SIGHUP then end this process as Ctrl-C does, so that the nodes are ended in order.
    """
    os.environ["ROS_DOMAIN_ID"] = str(claim_domain())
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)
