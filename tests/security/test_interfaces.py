"""No one on the network can make a node read or replace a file: only who starts a node sets paths."""

import pytest

from srt3d_ros.nodes import all_specs

WORDS = {"frequencies", "frame_id", "gate"}     # live strings without choices; none is a path


@pytest.mark.parametrize("name", all_specs())
def test_no_parameter_that_can_be_set_over_the_network_names_a_file(name):
    for parameter in all_specs()[name].table:
        if parameter.inactive:
            assert (name, parameter.name) == ("recorder", "path")      # a recorder replaces no file
        if parameter.live and isinstance(parameter.default, str) and not parameter.choices:
            assert parameter.name in WORDS and "path" not in parameter.form and "folder" not in parameter.form
