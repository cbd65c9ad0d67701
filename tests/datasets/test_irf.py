"""Instrument responses: drawn, read and estimated."""

import re

import numpy as np
import pytest
from scipy.io import savemat

from srt3d_ros.core.sensor.model import SensorModel
from srt3d_ros.datasets import irf, irf_files
from srt3d_ros.errors import InvalidInput
from srt3d_ros.photons import Photons
from tests.core.scenes import simulate
from tests.datasets import laboratory_files as files
from tests.datasets.laboratory_files import t3

pytestmark = pytest.mark.usefixtures("in_this_process")


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
    np.testing.assert_array_equal(irf_files.read(tmp_path / name)[0], values)
    np.testing.assert_array_equal(irf_files.read(str(tmp_path / name))[0], values)


VALUES = np.array([0, 1.5, 3, 0.5])


def sensor_with(irf_file, bin_width_s, num_bins=50, **options):
    """The sensor of a photon with this IRF, and the notes on the IRF."""
    photons = Photons.from_events([0], [0], [1], shape=(1, 1), num_bins=num_bins, bin_width_s=bin_width_s,
                                  irf=irf_file, fov_deg=10, toa_offset_bins=0, **options)
    return photons.sensor, " ".join(photons.notes)


@pytest.mark.parametrize(("name", "header", "times", "bin_width_s"), [
    ("a.csv", "time_ns,counts", "0.00 0.03 0.07 0.10", 1e-10 / 3),                  # rounded
    ("a.csv", "Laser diode\nTime (s),Amplitude", "1e-9 1.1e-9 1.2e-9 1.3e-9", 1e-10),
    ("a.txt", "", "0 0.1 0.2 0.3", 1e-10), ("a.txt", "", "0 100 200 300", 1e-10),
    ("a.csv", "bin,counts", "7 8 9 10", 1e-10)])
def test_the_second_of_two_columns_is_the_irf_if_the_first_is_its_time(tmp_path, name, header, times, bin_width_s):
    separator = "," if name == "a.csv" else " "
    lines = [f"{time}{separator}{value}" for time, value in zip(times.split(), VALUES)]
    (tmp_path / name).write_text("\n".join([header, *lines]))
    sensor, notes = sensor_with(tmp_path / name, bin_width_s)
    np.testing.assert_allclose(sensor.irf, VALUES / 5)
    assert not notes


@pytest.mark.parametrize("times", ["0 1 2 9", "3 2 1 0", "0 nan 2 3"])
def test_a_first_of_two_columns_that_is_no_time_is_refused(tmp_path, times):
    (tmp_path / "a.csv").write_text("\n".join(f"{time},1" for time in times.split()))
    with pytest.raises(InvalidInput, match="must be an even time axis"):
        irf_files.read(tmp_path / "a.csv")


@pytest.mark.parametrize("text", [
    "#PicoHarp 300  Histogram Data\t\t\t19.02.2023 15:51:51\n#channels per curve\n4\n#display curve no.\n0\n"
    "#memory block no.\n0\n#ns/channel\n0.0500\n#counts\n0\n1.5\n3\n0.5\n",
    "#HydraHarp 400\n#channels per curve\n4\t4\t\n#ns/bin\n0.05\t0.05\t\n#counts\n1\t0\t\n0\t1.5\t\n0\t3\t\n0\t0.5\t\n",
    '"Zeit [ps]";"Impulse"\n"0,0";"0"\n"50,0";"1,5"\n"100,0";"3"\n"150,0";"0,5"\n',
    "Time[ns]\tDecay[Cnts]\tIRF[Cnts]\n0\t90\t0\n0.05\t80\t1.5\n0.10\t70\t3\n0.15\t60\t0.5\n"])
def test_texts_of_laboratories_give_the_irf_and_its_time_step(tmp_path, text):
    (tmp_path / "a.dat").write_text(text)
    sensor, notes = sensor_with(tmp_path / "a.dat", 5e-11)
    np.testing.assert_allclose(sensor.irf, VALUES / 5)
    assert not notes
    with pytest.raises(InvalidInput, match=r"^a.dat has an entry every \S+ .s: give bin_width_s"):
        Photons.from_events([0], [0], [1], shape=(1, 1), num_bins=50, irf=tmp_path / "a.dat")


def test_the_bin_width_beside_an_irf_in_npz_is_its_time_step(tmp_path):
    np.savez(tmp_path / "a.npz", irf=VALUES, bin_width_s=1e-10)
    np.testing.assert_allclose(sensor_with(tmp_path / "a.npz", 1e-10)[0].irf, VALUES / 5)
    sensor, notes = sensor_with(tmp_path / "a.npz", 5e-11)
    assert "IRF resampled from steps of 100 ps to bins of 50 ps" in notes and sensor.irf.size == 9


def test_steps_of_one_are_bins_and_a_note_says_so(tmp_path):
    (tmp_path / "a.txt").write_text("0 0\n1 1.5\n2 3\n3 0.5\n")
    sensor, notes = sensor_with(tmp_path / "a.txt", 16e-12)
    np.testing.assert_allclose(sensor.irf, VALUES / 5)
    assert "taken to count bins" in notes


@pytest.mark.parametrize("step_ps", [4, 16, 37])
def test_other_steps_are_resampled_and_the_pulse_keeps_its_place_and_shape(tmp_path, step_ps):
    fine = irf.spad(step_ps * 1e-12, fwhm_s=300e-12)
    (tmp_path / "a.txt").write_text("\n".join(f"{step_ps * at} {value}" for at, value in enumerate(fine)))
    (tmp_path / "a.txt").write_text("t [ps] counts\n" + (tmp_path / "a.txt").read_text())
    sensor, notes = sensor_with(tmp_path / "a.txt", 25e-12, 300)
    assert notes == f"IRF resampled from steps of {step_ps} ps to bins of 25 ps (a.txt)"
    def mean_and_width(values, ref, width_ps):
        time = (np.arange(len(values)) - ref) * width_ps
        mean = time @ values / values.sum()
        return mean, np.sqrt((time - mean) ** 2 @ values / values.sum())
    before = mean_and_width(fine, np.argmax(fine), step_ps)
    after = mean_and_width(sensor.irf, sensor.irf_ref, 25)
    assert after == pytest.approx(before, abs=0.6)      # ps


def test_an_irf_of_another_step_on_the_axis_of_the_data_begins_where_it_does(tmp_path):
    (tmp_path / "a.txt").write_text("t [ps] n\n" + "\n".join(f"{40 * at} {9 * (at == 5)}" for at in range(20)))
    sensor, _ = sensor_with(tmp_path / "a.txt", 1e-11, 300, irf_ref=0)
    assert sensor.irf_ref == 0 and np.flatnonzero(sensor.irf).tolist() == [20, 21, 22, 23]


def test_an_irf_longer_than_the_period_is_cut_if_its_pulse_fits(tmp_path):
    long = np.ones(400)
    long[[250, 251, 252]] = 300, 500, 200
    sensor, notes = sensor_with(long, 1e-10, 100)
    assert "IRF cut from 400 bins to the 100" in notes
    assert sensor.irf.argmax() == sensor.irf_ref and (
        sensor.irf[sensor.irf_ref - 1] / sensor.irf.max() == pytest.approx(299 / 499))
    with pytest.raises(InvalidInput, match="irf length is 401: expected at most num_bins = 100: a period would hold"):
        sensor_with(irf.gaussian(49.9), 1e-10, 100)


@pytest.mark.parametrize("share", [0.005, 0.05, 0.3])
@pytest.mark.parametrize("noise", [False, True])
def test_the_floor_of_an_irf_is_taken_off_and_noted(share, noise):
    pulse, floor = np.zeros(400), 10_000 * share
    pulse[150:150 + 121] = 10_000 * np.exp(-0.5 * ((np.arange(121) - 40) / 10)**2)
    pulse[200:271] += 2000 * np.exp(-np.arange(71) / 15)
    measured = np.random.default_rng(0).poisson(pulse + floor) if noise else pulse + floor
    found, notes = irf.checked(measured.astype(float), 190)
    assert len(notes) == 1 and "the IRF's floor (dark counts), 0." in notes[0]
    assert found.sum() == pytest.approx(pulse.sum(), rel=0.02)
    again, none = irf.checked(found, 190)
    assert none == () and np.array_equal(again, found)
    of_pixels, notes = irf.checked(np.stack([measured, 2 * measured]).astype(float), 190)
    assert of_pixels[1].sum() == pytest.approx(2 * found.sum(), rel=0.02) and len(notes) == 1


@pytest.mark.parametrize("values", [
    irf.gaussian(3), irf.gaussian(3)[6:-6], irf.spad(8e-12), [1, 2, 1], np.exp(-np.arange(80) / 20), np.ones(30),
    np.exp(-0.5 * (np.arange(-20, 21) / 10)**2)])
def test_a_pulse_without_a_floor_is_kept(values):
    found, notes = irf.checked(np.array(values, float), None)
    assert notes == () and np.array_equal(found, values)


def test_an_irf_on_the_time_axis_of_the_data_is_noted_until_irf_ref_is_given():
    late = np.concatenate([np.zeros(100), irf.gaussian(3), np.zeros(50)])
    assert re.search("peaks in its bin 112.* irf_ref=0", sensor_with(late, 1e-10, 300)[1])
    assert sensor_with(late, 1e-10, 300, irf_ref=0)[1] == ""


@pytest.mark.parametrize("name", ["a.sdt", "a.phu", "a.ptu"])
def test_laboratory_files_are_irfs_of_their_brightest_data_set(tmp_path, name):
    pytest.importorskip("sdtfile" if name == "a.sdt" else "ptufile")
    curve = np.array([0, 15, 30, 5, 0, 0])
    if name == "a.sdt":
        files.sdt(tmp_path / name, [curve[None, None].astype(np.uint16), curve.reshape(1, 1, 6) * 2], 6e-10)
    elif name == "a.phu":
        files.phu(tmp_path / name, [curve * 0 + 1, curve], 1e-10)
    else:
        records = [t3(tick, toa, 1) for tick, toa in enumerate(np.arange(6).repeat(curve))]
        files.ptu(tmp_path / name, records, files.T3, {"Measurement_SubMode": 0})
    sensor, notes = sensor_with(tmp_path / name, 1e-10, 120)
    np.testing.assert_allclose(sensor.irf[:4], curve[:4] / 50)
    assert ("data set 1 of 2 in" in notes) == (name != "a.ptu")


def test_a_file_without_an_irf_is_refused(tmp_path):
    np.savez(tmp_path / "many.npz", first=np.ones(2), second=np.ones(3))
    with pytest.raises(InvalidInput, match="^many.npz has no array irf"):
        irf_files.read(tmp_path / "many.npz")
    savemat(tmp_path / "many.mat", {"a": np.arange(3.0), "b": np.arange(4.0)})
    with pytest.raises(InvalidInput, match=r"^many.mat: The file needs a variable irf .* It has a \(1×3 double\), b"):
        irf_files.read(tmp_path / "many.mat")


def test_an_estimate_comes_close_to_the_irf_that_made_the_photons():
    true = irf.spad(8e-12)
    sensor = SensorModel(40, 40, 1500, 8e-12, true)
    depth = np.random.default_rng(0).uniform(300, 1100, (40, 40))
    estimate = irf.estimate(simulate(depth, 5, 40, sensor, seed=1), 1500)
    estimate /= estimate.sum()
    assert abs(width_at_half(estimate) - width_at_half(true)) <= 2
    at = np.arange(-8, 25)
    np.testing.assert_allclose(estimate[np.argmax(estimate) + at[at >= -np.argmax(estimate)]],
                               true[np.argmax(true) + at[at >= -np.argmax(estimate)]], atol=0.15 * true.max())
    assert estimate[np.argmax(estimate):].sum() > estimate[:np.argmax(estimate)].sum()
