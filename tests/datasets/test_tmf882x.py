"""TMF882x: logs of histograms become ranges; with the reference pulse as IRF, without pile-up."""

import json

import numpy as np
import pytest

from srt3d_ros.datasets import Photons
from srt3d_ros.datasets.readers import histogram_logs, tmf882x
from tests.datasets import made_logs as made

SHOTS = 4e6
CENTRE = 4


def centre_mm(photons: Photons) -> float:
    """Range of the centre zone, with all frequencies that the pulse passes."""
    passed = np.flatnonzero(np.abs(np.fft.rfft(photons.sensor.irf, photons.sensor.num_bins)) > 0.1)
    return float(made.zones_mm(photons, tuple(range(1, passed[-1] + 1)))[1, 1])


def test_ranges_count_from_the_reference_pulse(tmp_path):
    readings = list(histogram_logs.frames(made.tmf882x_log(tmp_path / "log.json", [5.0, 12.3, 40.0]), {}))
    depths = [centre_mm(one) / one.sensor.bin_width_m / 1e3 for one in readings]
    assert depths == pytest.approx([5.0, 12.3, 40.0], abs=0.02)
    assert [one.frame.stamp_ns for one in readings] == [0, 10**9, 2 * 10**9]


def test_zones_lie_as_seen(tmp_path):
    capture = json.loads(made.tmf882x_log(tmp_path / "log.json", [10.0]).read_text())[0]
    capture["hists"] = [[0] * 40 + [zone] + [0] * 87 for zone in range(9)]
    counts = tmf882x.of_capture(capture, "capture").frame.counts[..., 40]
    assert counts.tolist() == [[2, 1, 0], [5, 4, 3], [8, 7, 6]]


@pytest.mark.parametrize("photons", [1e4, 6e6])
def test_counts_become_rates(photons):
    rate = 150 + photons * made.pulse(128, np.array([30.3, 60.0]))
    counted = made.first_photons(rate, SHOTS)
    assert tmf882x.without_pile_up(counted, SHOTS) == pytest.approx(rate, rel=2e-3, abs=1)


def test_above_the_shots_counts_stay_finite():
    assert np.isfinite(tmf882x.without_pile_up(np.full((3, 50), 1e5), 1000.0)).all()


def test_the_background_tells_the_shots():
    counted = made.first_photons(150 + 3e6 * made.pulse(128, np.full(9, 40.0)), SHOTS)
    assert tmf882x.shots_of(np.random.default_rng(0).poisson(counted), 10) == pytest.approx(SHOTS, rel=0.05)


@pytest.mark.parametrize("ambient, photons", [(0, 1e6), (150, 0), (150, 1e3)])
def test_a_background_that_tells_nothing(ambient, photons):
    counted = made.first_photons(ambient + photons * made.pulse(128, np.full(9, 40.0)), SHOTS)
    assert tmf882x.shots_of(np.random.default_rng(0).poisson(counted), 10) == np.inf


def test_a_plane_moved_by_a_robot(shared_data):
    """docs/photon-file.md has the figures. Either half of the captures fits distance = a · range + b for the other."""
    path = shared_data / "histograms" / "tmf8820_plane_distances.json"
    if not path.is_file():
        pytest.skip(f"no {path}")
    captures = json.loads(path.read_text())
    truth = np.array([capture["dist_to_plane"] for capture in captures]) * 1e3
    vendor = np.array([capture["distances"][0]["depths_1"][CENTRE] for capture in captures], float)
    ranged = np.flatnonzero([capture["distances"][0]["confs_1"][CENTRE] > 0 for capture in captures])
    found = np.array([centre_mm(photons) for photons in histogram_logs.frames(path, {})])

    def errors(ranges_mm: np.ndarray, used: np.ndarray, half: int) -> np.ndarray:
        fitted, tested = used[half::2], used[1 - half::2]
        return np.abs(np.polyval(np.polyfit(ranges_mm[fitted], truth[fitted], 1), ranges_mm[tested]) - truth[tested])

    for half in (0, 1):
        off = errors(found, np.arange(len(truth)), half)
        assert np.median(off) <= 1.0 and np.percentile(off, 95) <= 2.0 and off.max() <= 6.0
        assert np.percentile(errors(found, ranged, half), 95) < np.percentile(errors(vendor, ranged, half), 95)
