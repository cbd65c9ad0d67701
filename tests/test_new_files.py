"""New files appear whole or not at all, and those that must not replace others get a name of their own."""

import pytest

from srt3d_ros.new_files import appearing_whole, free, next_free


def test_a_file_takes_its_place_at_the_end(tmp_path):
    path = tmp_path / "cloud.ply"
    path.write_text("old")
    with appearing_whole(path) as part:
        part.write_text("new")
        assert part.suffix == ".ply" and path.read_text() == "old"
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]


def test_after_a_failure_all_is_as_before(tmp_path):
    path = tmp_path / "cloud.ply"
    path.write_text("old")
    with pytest.raises(OSError, match="full"), appearing_whole(path) as part:
        part.write_text("half")
        raise OSError("full")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_file_is_written_beside_no_matter_what_links_lie_in_wait(tmp_path, monkeypatch):
    path, treasure = tmp_path / "cloud.ply", tmp_path / "treasure"
    path.symlink_to(treasure)
    with appearing_whole(path) as part:
        assert part.exists() and not part.is_symlink()
        part.write_text("new")
    assert not treasure.exists() and not path.is_symlink() and path.read_text() == "new"
    monkeypatch.setattr("secrets.token_hex", lambda length: "guessed")
    with appearing_whole(path) as guessed:
        pass
    guessed.symlink_to(treasure)
    with pytest.raises(FileExistsError), appearing_whole(path):
        pass
    assert not treasure.exists()


def test_a_free_name_is_kept_and_that_of_a_broken_link_is_not(tmp_path):
    assert free(tmp_path / "a.ply") == tmp_path / "a.ply"
    (tmp_path / "a.ply").symlink_to(tmp_path / "nothing")
    assert free(tmp_path / "a.ply") == tmp_path / "a_2.ply"


def test_the_next_free_name_is_not_that_of_a_broken_link(tmp_path):
    (tmp_path / "a_2.rrd").symlink_to(tmp_path / "treasure")
    assert next_free(tmp_path / "a.rrd") == tmp_path / "a_3.rrd"


def test_the_next_free_name_is_the_first_where_nothing_is(tmp_path):
    for name in ("a.rrd", "a_2.rrd", "a_4.rrd"):
        (tmp_path / name).touch()
    assert next_free(tmp_path / "a.rrd") == tmp_path / "a_3.rrd"
