"""Instrument responses: drawn, read and estimated."""

import numpy as np
import pytest
from scipy.io import savemat

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets import irf
from srt3d_ros.datasets.simulation.scene import StaticScene
from srt3d_ros.datasets.simulation.simulator import Simulator
from srt3d_ros.errors import InvalidInput
from srt3d_ros.photons import Photons


def width_at_half(response: np.ndarray) -> float:
    above = np.flatnonzero(response >= response.max() / 2)
    return above[-1] - above[0] + 1


@pytest.mark.parametrize("bin_width_s", [1e-12, 5e-12])
def test_the_spad_response_has_its_width_in_time_and_decays_with_the_tail(bin_width_s):
    response, late = irf.spad(bin_width_s), irf.spad(bin_width_s)[round(300e-12 / bin_width_s):]
    assert response.sum() == pytest.approx(1) and response.dtype == np.float32
    assert width_at_half(irf.spad(bin_width_s, tail_share=0)) * bin_width_s == pytest.approx(55e-12)
    assert late[round(100e-12 / bin_width_s)] / late[0] == pytest.approx(1 / np.e, rel=1e-3)


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a.csv", "a.txt", "column.csv", "named.mat", "only.mat"])
def test_every_kind_of_file_is_read(tmp_path, name):
    values = np.array([0.0, 1.5, 3.0, 0.5])
    np.save(tmp_path / "a.npy", values)
    np.savez(tmp_path / "a.npz", irf=values, other=np.ones(2))
    (tmp_path / "a.csv").write_text("0,1.5,3,0.5\n")
    (tmp_path / "a.txt").write_text("# a response\n0\n1.5\n3\n0.5\n")
    (tmp_path / "column.csv").write_text("counts\n0\n1.5\n3\n0.5\n")
    savemat(tmp_path / "named.mat", {"irf": values, "t": np.arange(4.0)})
    savemat(tmp_path / "only.mat", {"h": values[:, None], "name": "laser", "rate": 5.0, "image": np.ones((2, 3))})
    np.testing.assert_array_equal(irf.read(tmp_path / name)[0], values)
    np.testing.assert_array_equal(irf.read(str(tmp_path / name))[0], values)


@pytest.mark.parametrize(("name", "header", "times", "bin_width_s", "refused"), [
    ("a.csv", "time_ns,counts", "0.00 0.03 0.07 0.10", 1e-10 / 3, ""),                  # rounded
    ("a.csv", "Laser diode\nTime (s),Amplitude", "1e-9 1.1e-9 1.2e-9 1.3e-9", 1e-10, ""),
    ("a.txt", "# t [ps] counts", "0 50 100 150", 1e-10, "line every 50 ps, but a bin has 100 ps"),
    ("a.txt", "", "0 0.1 0.2 0.3", 1e-10, ""), ("a.csv", "", "0 0.2 0.4 0.6", 1e-10, "line every 0.2, but a bin"),
    ("a.csv", "bin,counts", "7 8 9 10", 1e-10, ""), ("a.csv", "ps,counts", "7 8 9 10", 1e-10, "line every 1 ps"),
    ("a.csv", "", "0 1 2 9", 1e-10, "must be an even time axis"), ("a.csv", "", "3 2 1 0", 1e-10, "must be an even"),
    ("a.csv", "", "0 nan 2 3", 1e-10, "must be an even")])
def test_the_second_of_two_columns_is_the_irf_and_the_first_must_count_its_bins(tmp_path, name, header, times,
                                                                               bin_width_s, refused):
    separator, values = "," if name == "a.csv" else " ", [0, 1.5, 3, 0.5]
    lines = [f"{time}{separator}{value}" for time, value in zip(times.split(), values)]
    (tmp_path / name).write_text("\n".join([header, *lines]))
    def found():
        return Photons.from_events([0], [0], [9], shape=(1, 1), num_bins=50, bin_width_s=bin_width_s,
                                   irf=tmp_path / name).sensor
    if refused:
        with pytest.raises(InvalidInput, match=refused):
            found()
    else:
        np.testing.assert_allclose(found().irf, np.array(values) / 5)


@pytest.mark.parametrize(("name", "content"), [
    ("a.npy", b""), ("a.npz", b"not a zip"), ("a.csv", b"one,two\n"), ("a.txt", b"\xff\xfe\x80"), ("a.doc", b"1\n"),
    ("a.npy", b"\x93NUMPY\x01\0\x02\0{("), ("a.txt", b"# nothing\n"), ("a.mat", b"MATLAB"), ("a.csv", b"1\n2,3\n"),
])
@pytest.mark.filterwarnings("error")
def test_broken_files_are_one_line(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput) as caught:
        irf.read(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_file_without_an_irf_is_refused(tmp_path):
    np.savez(tmp_path / "many.npz", first=np.ones(2), second=np.ones(3))
    with pytest.raises(InvalidInput, match="^many.npz has no array irf"):
        irf.read(tmp_path / "many.npz")
    savemat(tmp_path / "many.mat", {"a": np.arange(3.0), "b": np.arange(4.0)})
    with pytest.raises(InvalidInput, match=r"^many.mat: The file needs a variable irf .* It has a \(1×3 double\), b"):
        irf.read(tmp_path / "many.mat")


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
