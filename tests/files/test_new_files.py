"""New files appear whole or not at all, and those that must not replace others get a name of their own."""


import pytest

from srt3d_ros.errors import InvalidInput
from srt3d_ros.files.new_files import atomic_write, check_not_input, free


def test_a_file_is_written_beside_no_matter_what_links_lie_in_wait(tmp_path, monkeypatch):
    path, treasure = tmp_path / "cloud.ply", tmp_path / "treasure"
    path.symlink_to(treasure)
    with atomic_write(path) as part:
        assert part.exists() and not part.is_symlink()
        part.write_text("new")
    assert not treasure.exists() and not path.is_symlink() and path.read_text() == "new"
    monkeypatch.setattr("secrets.token_hex", lambda length: "guessed")
    with atomic_write(path) as guessed:
        pass
    guessed.symlink_to(treasure)
    with pytest.raises(FileExistsError), atomic_write(path):
        pass
    assert not treasure.exists()


def test_an_output_must_not_be_an_input_whatever_it_is_called(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    path, other = tmp_path / "a.npz", tmp_path / "b.npz"
    path.touch()
    other.touch()
    (tmp_path / "link.npz").symlink_to(path)
    (tmp_path / "hard.npz").hardlink_to(path)
    for spelling in ("./folder/../a.npz", "link.npz", "hard.npz"):
        with pytest.raises(InvalidInput, match="^Cannot write .*: it is the input"):
            check_not_input(spelling, other, None, path)
        check_not_input(other, spelling, None, "absent.npz")
        check_not_input("absent.npz", spelling, "absent.npz")


def test_a_free_name_is_the_first_where_nothing_is_not_even_a_broken_link(tmp_path):
    path = tmp_path / "a.rrd"
    assert free(path) == path
    path.symlink_to(tmp_path / "nothing")
    assert free(path) == tmp_path / "a_2.rrd"
    (tmp_path / "a_2.rrd").symlink_to(tmp_path / "nothing")
    (tmp_path / "a_4.rrd").touch()
    assert free(path) == tmp_path / "a_3.rrd"
