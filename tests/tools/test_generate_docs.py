"""What is written about the parameters cannot drift from the tables."""

import pytest

from tools.generate_docs import generated


@pytest.mark.parametrize("path", generated())
def test_a_generated_file_is_what_the_tables_make(repository, path):
    assert (repository / path).read_text() == generated()[path], "run python -m tools.generate_docs"
