"""A node says what the library logs."""

import logging

import pytest
import torch

from srt3d_ros.nodes.log_forwarding import LogForwarding


class Logger:
    """As much of a node's logger as is needed."""

    def __init__(self):
        self.said = []

    def info(self, text):
        self.said.append(("info", text))

    def warning(self, text):
        self.said.append(("warning", text))


def test_what_the_library_logs_is_said_until_the_node_is_closed():
    logger, library = Logger(), logging.getLogger("srt3d_ros.core.device")
    relay = LogForwarding(logger)
    library.info("no %s", "device")
    library.warning("beware")
    library.debug("details")
    logging.getLogger("others").warning("not ours")
    relay.close()
    library.warning("nobody listens")
    assert logger.said == [("info", "no device"), ("warning", "beware")]


@pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has CUDA")
def test_where_there_is_no_gpu_the_reconstructor_says_so(graph):
    process = graph.start("reconstructor").ready()
    assert process.text.count("no CUDA device: computing on the CPU") == 1
