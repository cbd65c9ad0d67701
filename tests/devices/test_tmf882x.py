"""TMF882x: logs of histograms become ranges; with the reference pulse as IRF, without pile-up."""

import json

import numpy as np
import pytest

from benchmarks import devices as benchmark
from srt3d_ros.devices import tmf882x
from srt3d_ros.errors import InvalidInput
from tests.devices import made

SHOTS = 4e6


def test_ranges_count_from_the_reference_pulse(tmp_path):
    readings = list(tmf882x.read(made.tmf882x_log(tmp_path / "log.json", [5.0, 12.3, 40.0])))
    depths = [benchmark.centre_mm(one, benchmark.passed(one.sensor)) / one.sensor.bin_width_m / 1e3 for one in readings]
    assert depths == pytest.approx([5.0, 12.3, 40.0], abs=0.02)
    assert [one.frame.stamp_ns for one in readings] == [0, 10**9, 2 * 10**9]


def test_zones_lie_as_seen(tmp_path):
    capture = json.loads(made.tmf882x_log(tmp_path / "log.json", [10.0]).read_text())[0]
    capture["hists"] = [[0] * 40 + [zone] + [0] * 87 for zone in range(9)]
    counts = tmf882x.reading(capture, "capture").frame.counts[..., 40]
    assert counts.tolist() == [[2, 1, 0], [5, 4, 3], [8, 7, 6]]


@pytest.mark.parametrize("content", ["{}", "[]", "[3]", '[{"hists": [[1]], "reference_hist": [1]}]', "[",
                                     json.dumps([{"hists": [[0] * 128] * 9, "reference_hist": [1] + [0] * 127}]),
                                     json.dumps([{"hists": [[0] * 128] * 9, "reference_hist": ["x"] * 128}])])
def test_broken_logs_are_refused(tmp_path, content):
    path = tmp_path / "log.json"
    path.write_text(content)
    with pytest.raises(InvalidInput, match="log.json"):
        list(tmf882x.read(path))


@pytest.mark.parametrize("photons", [1e4, 6e6])
def test_counts_become_rates(photons):
    rate = 150 + photons * made.pulse(128, np.array([30.3, 60.0]))
    counted = made.first_photons(rate, SHOTS)
    assert tmf882x.without_pile_up(counted, SHOTS) == pytest.approx(rate, rel=2e-3, abs=1)


def test_without_shots_counts_stay_and_above_the_shots_they_stay_finite():
    counted = np.arange(12, dtype=np.int32).reshape(2, 6)
    assert (tmf882x.without_pile_up(counted, np.inf) == counted).all()
    assert np.isfinite(tmf882x.without_pile_up(np.full((3, 50), 1e5), 1000.0)).all()


def test_the_background_tells_the_shots():
    counted = made.first_photons(150 + 3e6 * made.pulse(128, np.full(9, 40.0)), SHOTS)
    assert tmf882x.shots_of(np.random.default_rng(0).poisson(counted), 10) == pytest.approx(SHOTS, rel=0.05)


@pytest.mark.parametrize("ambient, photons", [(0, 1e6), (150, 0), (150, 1e3)])
def test_a_background_that_tells_nothing(ambient, photons):
    counted = made.first_photons(ambient + photons * made.pulse(128, np.full(9, 40.0)), SHOTS)
    assert tmf882x.shots_of(np.random.default_rng(0).poisson(counted), 10) == np.inf


def test_a_plane_moved_by_a_robot(shared_data):
    """The figures of docs/devices.md, and their goals: either half of the captures fits the line, the other tests."""
    path = shared_data / "histograms" / "tmf8820_plane_distances.json"
    if not path.is_file():
        pytest.skip(f"no {path}")
    for half in benchmark.tmf882x_errors(path):
        median, p95, worst = half["errors_mm"]
        assert median <= 1.0 and p95 <= 2.0 and worst <= 6.0
        assert half["valid_errors_mm"][1] < half["vendor_valid_mm"][1]
