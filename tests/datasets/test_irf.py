"""Instrument responses: drawn, read and estimated."""

import numpy as np
import pytest

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets import irf
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput


def width_at_half(response: np.ndarray) -> float:
    above = np.flatnonzero(response >= response.max() / 2)
    return above[-1] - above[0] + 1


@pytest.mark.parametrize("bin_width_s", [1e-12, 5e-12])
def test_the_spad_response_has_its_width_in_time_and_decays_with_the_tail(bin_width_s):
    response, late = irf.spad(bin_width_s), irf.spad(bin_width_s)[round(300e-12 / bin_width_s):]
    assert response.sum() == pytest.approx(1) and response.dtype == np.float32
    assert width_at_half(irf.spad(bin_width_s, tail_share=0)) * bin_width_s == pytest.approx(55e-12)
    assert late[round(100e-12 / bin_width_s)] / late[0] == pytest.approx(1 / np.e, rel=1e-3)


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.csv", "a.txt", "column.csv"])
def test_every_kind_of_file_is_read(tmp_path, name):
    values = np.array([0.0, 1.5, 3.0, 0.5])
    np.save(tmp_path / "a.npy", values)
    np.savez(tmp_path / "a.npz", irf=values, other=np.ones(2))
    (tmp_path / "a.csv").write_text("0,1.5,3,0.5\n")
    (tmp_path / "a.txt").write_text("# a response\n0\n1.5\n3\n0.5\n")
    (tmp_path / "column.csv").write_text("0\n1.5\n3\n0.5\n")
    np.testing.assert_array_equal(irf.read(tmp_path / name), values)
    np.testing.assert_array_equal(irf.read(str(tmp_path / name)), values)


@pytest.mark.parametrize(("name", "content"), [
    ("a.npy", b""), ("a.npz", b"not a zip"), ("a.csv", b"one,two\n"), ("a.txt", b"\xff\xfe\x80"), ("a.doc", b"1\n"),
    ("a.npy", b"\x93NUMPY\x01\0\x02\0{("), ("a.txt", b"# nothing\n"),
])
@pytest.mark.filterwarnings("error")
def test_broken_files_are_one_line(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput) as caught:
        irf.read(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_an_npz_without_a_response_is_refused(tmp_path):
    np.savez(tmp_path / "many.npz", first=np.ones(2), second=np.ones(3))
    with pytest.raises(InvalidInput, match="^many.npz has no array irf"):
        irf.read(tmp_path / "many.npz")


def test_an_estimate_comes_close_to_the_irf_that_made_the_photons():
    true = irf.spad(8e-12)
    sensor = SensorModel(40, 40, 1500, 8e-12, true)
    depth = np.random.default_rng(0).uniform(300, 1100, (40, 40))
    events, _ = Simulator(StaticScene(sensor.range_m(depth)), sensor, sbr=5, ppp=40, seed=1).frame(0)
    estimate = irf.estimate(events, 1500)
    estimate /= estimate.sum()
    assert abs(width_at_half(estimate) - width_at_half(true)) <= 2
    at = np.arange(-8, 25)
    np.testing.assert_allclose(estimate[np.argmax(estimate) + at[at >= -np.argmax(estimate)]],
                               true[np.argmax(true) + at[at >= -np.argmax(estimate)]], atol=0.15 * true.max())
    assert estimate[np.argmax(estimate):].sum() > estimate[:np.argmax(estimate)].sum()
