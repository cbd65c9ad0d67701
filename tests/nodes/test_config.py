"""What is written about the parameters cannot drift from the tables."""

import pytest

from srt3d_ros.nodes.tables import generated


@pytest.mark.parametrize("path", generated())
def test_a_generated_file_is_what_the_tables_make(repository, path):
    assert (repository / path).read_text() == generated()[path], "run python -m srt3d_ros.nodes.tables"
