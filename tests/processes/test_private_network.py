"""Domains of programs on one machine."""

import socket

import pytest

from srt3d_ros.processes import private_network
from srt3d_ros.processes.private_network import MOST, PORTS, USED_PORT, claim_domain


@pytest.fixture(autouse=True)
def claims(monkeypatch):
    """Claims of these tests alone, given up after each."""
    own: list[socket.socket] = []
    monkeypatch.setattr(private_network, "_claims", own)
    yield own
    for claim in own:
        claim.close()


def test_no_two_programs_have_the_same_domain(claims):
    claimed = [claim_domain() for _ in range(20)]
    assert len(set(claimed)) == 20 and all(1 <= domain <= MOST for domain in claimed)


def test_a_domain_that_is_in_use_is_left_alone(claims, monkeypatch):
    monkeypatch.setattr(private_network, "MOST", 2)
    monkeypatch.setattr(private_network, "FIRST_PORT", 30_000)      # others on this machine may use the real ones
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as used:
        used.bind(("", 30_000 + PORTS + USED_PORT))
        assert claim_domain() == 2
        with pytest.raises(OSError, match="every ROS domain from 1 to 2 is in use"):
            claim_domain()
