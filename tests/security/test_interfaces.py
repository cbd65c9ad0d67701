"""What the network may ask of a node names no file: paths are set by who starts the node."""

import pytest

from srt3d_ros.nodes import all_specs

WORDS = {"frequencies", "frame_id", "gate"}     # live texts without choices; none is ever a path


@pytest.mark.parametrize("name", all_specs())
def test_no_parameter_that_can_be_set_over_the_network_names_a_file(name):
    for parameter in all_specs()[name].table:
        if parameter.live and isinstance(parameter.default, str) and not parameter.choices:
            assert parameter.name in WORDS and "path" not in parameter.form and "folder" not in parameter.form
