"""A ROS domain for one program, so that programs on a machine do not receive each other's messages."""

import contextlib
import os
import random
import signal
import socket

FIRST_PORT, PORTS = 7400, 250       # first UDP port of domain 0, and ports per domain (RTPS 2.5, 9.6.2.3)
USED_PORT = 10                      # offset of the port that the first program in a domain binds
MOST = 100                          # highest domain below the ports that operating systems assign to any program

held: list = []         # sockets and files that stay open until this process ends


def bind(*ports: int) -> list[socket.socket]:
    """UDP sockets bound to these ports; an empty list if one of the ports is in use."""
    with contextlib.ExitStack() as opened:
        bound = [opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in ports]
        for one, port in zip(bound, ports):
            try:
                one.bind(("", port))
            except OSError:
                return []
        opened.pop_all()
        return bound


def claim_domain() -> int:
    """Claim a ROS domain, 1 to MOST, that no program on this machine uses or has claimed, until this process ends.

    The claim is the domain's last UDP port, which stays bound. Raises OSError if no domain is free.
    """
    for domain in random.SystemRandom().sample(range(1, MOST + 1), MOST):
        first_port = FIRST_PORT + PORTS * domain
        if bound := bind(first_port + PORTS - 1, first_port + USED_PORT):
            claim, discovery = bound
            discovery.close()
            held.append(claim)
            return domain
    raise OSError(f"every ROS domain from 1 to {MOST} is in use on this machine")


def join_private_network() -> None:
    """Restrict this process and its children to this machine and to a ROS domain of their own.

    Call it before rclpy is imported. SIGTERM and SIGHUP then act as Ctrl-C, so that the nodes are stopped in order.
    """
    os.environ["ROS_DOMAIN_ID"] = str(claim_domain())
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, signal.default_int_handler)
