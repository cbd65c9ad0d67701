"""What is evaluated: settings of simulated scenes, and photon files."""

import numpy as np
import pytest

from srt3d_ros.datasets.simulation.scene import default_sensor
from srt3d_ros.errors import InvalidInput
from srt3d_ros.evaluation.cases import of_files, simulated, tolerance_bins
from srt3d_ros.evaluation.scenes import NetScene, net_sensor


def test_every_setting_is_a_case_of_the_photons_it_says():
    cases = simulated("net", [10, 0.5], [3, 30], repeats=2)
    assert [(case.sbr, case.ppp, case.repeat) for case in cases] == [
        (sbr, ppp, repeat) for sbr in (10, 0.5) for ppp in (3, 30) for repeat in (1, 2)]
    for case in cases:
        seen = case.observe()
        assert seen.frame.photons / case.sensor.pixels == pytest.approx(case.ppp, rel=0.2)
        assert seen.intensity.sum(axis=0).mean() == pytest.approx(case.ppp / (1 + 1 / case.sbr), rel=1e-3)
        assert seen.depth_bins.shape == (2, 32, 32) and case.source == "net" and case.surfaces == 2
    assert not np.array_equal(cases[0].observe().frame.toa, cases[1].observe().frame.toa)       # another draw
    assert np.array_equal(cases[0].observe().frame.toa, cases[0].observe().frame.toa)


def test_the_net_waves_before_the_plane():
    (net, plane), (later, same) = (NetScene(net_sensor()).frame(t_s)[0] for t_s in (0.0, 1.0))
    both = np.isfinite(net) & np.isfinite(plane)
    assert 0.5 < both.mean() < 1 and (plane[both] - net[both]).min() > 0.8
    assert np.nanmax(np.abs(later - net)) > 0.05 and np.array_equal(same, plane, equal_nan=True)


def test_a_file_has_as_many_surfaces_as_references_and_a_name_of_its_own(layers):
    case, = of_files([str(layers)])
    assert (case.source, case.sbr, case.surfaces, case.tolerance_bins) == ("layers", None, 2, 10)
    assert case.observe().depth_bins.shape == (2, 12, 20) and case.observe().intensity is None
    case, = of_files([str(layers)], "40", surfaces=1)
    assert (case.surfaces, case.tolerance_bins) == (1, 40)
    with pytest.raises(InvalidInput, match="^Two files are called layers: rename one"):
        of_files([str(layers), str(layers)])


def test_what_is_to_be_known_about_a_file_is_passed_on(layers, tmp_path):
    with np.load(layers) as file:
        np.savez(tmp_path / "bare.npz", **{name: file[name] for name in file.files if name != "bin_width_s"})
    case, = of_files([str(tmp_path / "bare.npz")])
    assert len(case.notes) == 1 and case.notes[0].startswith("bare: bin width taken as 2")


def test_a_tolerance_is_in_bins_or_millimetres_of_range():
    assert tolerance_bins("2.5", default_sensor()) == 2.5
    assert tolerance_bins("30mm", default_sensor()) == pytest.approx(100)
    assert tolerance_bins("75mm", net_sensor()) == pytest.approx(2, rel=0.01)           # bins of 250 ps


@pytest.mark.parametrize("text", ["", "near", "10,20", "-3", "nan", "inf", "0mm"])
def test_what_is_no_tolerance_is_refused_in_one_line(text):
    with pytest.raises(InvalidInput, match=r"^--tolerance is .*: expected "):
        tolerance_bins(text, default_sensor())
