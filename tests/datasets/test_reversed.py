"""Files whose times run backwards."""

import numpy as np
import pytest

from srt3d_ros import Photons, read
from srt3d_ros.cli.main import main
from srt3d_ros.datasets.irf import spad

IRF, T = spad(8e-12), 400
KNOWN = {"bin_width_s": 8e-12, "fov_deg": 10}


def scene() -> np.ndarray:
    """Counts [rows, cols, bins] of a sloping wall, with the tail of the IRF."""
    rng = np.random.default_rng(1)
    counts = rng.poisson(0.01, (6, 8, T))
    for row, col in np.ndindex(6, 8):
        counts[row, col, 90 + 3 * row:90 + 3 * row + len(IRF)] += rng.poisson(500 * IRF)
    return counts.astype(np.uint16)


@pytest.mark.parametrize("as_events", [True, False])
@pytest.mark.parametrize("irf", [True, False])
def test_a_reversed_file_is_read_like_the_straight_one(tmp_path, monkeypatch, as_events, irf):
    if not as_events:
        monkeypatch.setattr("srt3d_ros.datasets.arrays.MAX_KEPT", 100)
    np.save(tmp_path / "straight.npy", scene())
    np.save(tmp_path / "back.npy", scene()[..., ::-1])
    straight = read(tmp_path / "straight.npy", **KNOWN, **({"irf": IRF} if irf else {}))
    back = read(tmp_path / "back.npy", reversed=True, **KNOWN, **({"irf": IRF[::-1]} if irf else {}))
    counts = [np.bincount(one.events.pixel * T + one.events.toa, minlength=48 * T) for one in (straight, back)]
    np.testing.assert_array_equal(*counts)
    if irf:
        assert back.sensor.same_as(straight.sensor)
    assert not any("tail" in note for note in (*straight.notes, *back.notes))


def test_a_gate_and_a_sensor_are_of_the_straight_times(tmp_path):
    np.save(tmp_path / "back.npy", scene()[..., ::-1])
    sensor = Photons.from_counts(scene(), irf=IRF, background_shape=np.arange(1, T + 1.0), **KNOWN).sensor
    gated = read(tmp_path / "back.npy", reversed=True, gate=(80, 199), sensor=sensor)
    assert gated.photons == scene()[..., 80:200].sum() and gated.sensor.toa_offset_bins == 80
    np.testing.assert_allclose(gated.sensor.irf, IRF)
    whole = read(tmp_path / "back.npy", reversed=True, sensor=sensor)
    assert whole.sensor.same_as(sensor) and whole.sensor.irf_ref == IRF.argmax()


def test_float_times_stay_inside_the_period():
    photons = Photons.from_events([0, 0], [0, 0], [0.25, T - 0.5], shape=(1, 1), num_bins=T, irf=[1], **KNOWN)
    np.testing.assert_allclose(photons.reversed().frame.toa, [T - 1.25, T - 0.5])


def test_a_tail_on_the_wrong_side_is_noted_on_the_command_line(tmp_path, capsys):
    np.save(tmp_path / "back.npy", scene()[..., ::-1])
    command = ["info", str(tmp_path / "back.npy"), "--bin-width-s", "8e-12"]
    main(command)
    assert "give reversed (--reversed)" in capsys.readouterr().err
    main([*command, "--reversed"])
    assert "tail" not in capsys.readouterr().err
