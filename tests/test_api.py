"""The library: from arrays, counts, files or sketches to a cloud that is drawn and saved."""

import inspect
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import savemat

import srt3d_ros
from srt3d_ros import api
from srt3d_ros.core.keys import keys
from srt3d_ros.core.method.pooled import Pooled
from srt3d_ros.core.methods import METHODS, MethodOptions
from srt3d_ros.core.point_cloud import PointCloud
from srt3d_ros.core.sensor.model import GateWords
from srt3d_ros.core.sensor.projection import Pinhole
from srt3d_ros.core.sketching.design import design_sketch
from srt3d_ros.core.sketching.frame_sketcher import sketch_photons
from srt3d_ros.datasets import photon_file
from srt3d_ros.progress import FIRST_KERNELS
from tests.core.scenes import simulate
from tests.photon_forms import as_gates, as_histograms

SENSOR = srt3d_ros.Sensor(12, 20, 300, 5e-11, np.exp(-np.linspace(-2, 3, 21)**2), toa_offset_bins=1_000)
DEPTH = 80 + np.arange(20.0) + np.zeros((12, 1))
FRAME = simulate(DEPTH, 10, 60, SENSOR)
ROW, COL = np.divmod(FRAME.pixel, 20)
COUNTS = as_histograms(FRAME, SENSOR).counts.astype(np.int64)
FREQUENCIES = design_sketch(SENSOR, frame=FRAME).frequencies
PHOTONS = srt3d_ros.from_events(ROW, COL, FRAME.toa, sensor=SENSOR)
ARRAYS = {"shape": (12, 20), "num_bins": 300, "bin_width_s": 5e-11, "irf": SENSOR.irf, "fov_deg": 20,
          "projection": None, "toa_offset_bins": 0}


def same(one: PointCloud, other: PointCloud, fields=("row", "col", "depth_bins", "intensity", "xyz", "background")):
    for name in fields:
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-4, atol=2e-4, err_msg=name)


@pytest.fixture(scope="module")
def cloud():
    return PHOTONS.reconstruct()


def test_it_is_the_reconstruction_of_the_library(cloud):
    expected = Pooled(SENSOR, FREQUENCIES)(sketch_photons(FRAME, SENSOR, FREQUENCIES))
    same(cloud, expected)
    assert isinstance(cloud, srt3d_ros.Cloud) and len(cloud) == 240
    assert cloud.sensor.same_as(SENSOR) and cloud.notes == ()
    assert cloud.frequencies == FREQUENCIES and cloud.photons == FRAME.photons
    assert abs(np.median(cloud.depth_bins - DEPTH[cloud.row, cloud.col])) < 0.2


def test_every_form_of_the_same_photons_gives_the_same_cloud(cloud, tmp_path):
    photon_file.save(tmp_path / "photons.npz", SENSOR, FRAME)
    for source in (srt3d_ros.read(tmp_path / "photons.npz"), str(tmp_path / "photons.npz"), PHOTONS, PHOTONS.sketch()):
        same(srt3d_ros.reconstruct(source), cloud)
    for source in (FRAME, sketch_photons(FRAME, SENSOR, FREQUENCIES), COUNTS):
        same(srt3d_ros.reconstruct(source, sensor=SENSOR), cloud)
    same(srt3d_ros.from_counts(COUNTS, sensor=SENSOR).reconstruct(), cloud)
    same(srt3d_ros.from_events(ROW.tolist(), COL, FRAME.toa.astype(float), sensor=SENSOR).reconstruct(), cloud)
    words = SENSOR.replace(gates=GateWords())
    gates = as_gates(FRAME, words)              # whose cycles are counted, to correct pile-up
    same(srt3d_ros.reconstruct(gates, sensor=words), srt3d_ros.reconstruct(PHOTONS, cycles=len(gates.words)))


def test_the_callers_sensor_wins_over_a_file_and_a_note_says_so(tmp_path):
    mine = SENSOR.replace(projection=Pinhole(50, 50, 9, 9), gain=np.ones((12, 20)))
    savemat(tmp_path / "photons.mat", {"counts": COUNTS, "bin_width_s": 9e-11})
    read = srt3d_ros.read(tmp_path / "photons.mat", sensor=mine)
    assert read.sensor.same_as(mine) and np.array_equal(np.sort(read.events.toa), np.sort(FRAME.toa))
    assert read.notes == ("as given, not as in the file: bin_width_s",)


def test_what_a_photon_file_lacks_can_be_given(tmp_path):
    np.savez(tmp_path / "a.npz", rows=12, cols=20, num_bins=300, pixel=FRAME.pixel, toa=FRAME.toa)
    assert [note[:9] for note in srt3d_ros.read(tmp_path / "a.npz").notes] == ["bin width", "IRF estim", "geometry "]
    assert srt3d_ros.read(tmp_path / "a.npz", bin_width_s=5e-11, irf=SENSOR.irf, fov_deg=20,
                         toa_offset_bins=0).notes == ()
    estimated = srt3d_ros.read(tmp_path / "a.npz", bin_width_s=5e-11)
    assert [note.split()[0] for note in estimated.notes] == ["IRF", "ranges", "geometry"]
    # What is known is assumed no longer.
    for given in ({"irf": SENSOR.irf, "fov_deg": 30, "range_offset_m": 0}, {"sensor": SENSOR}):
        assert srt3d_ros.read(estimated, **given).notes == ()
    np.save(tmp_path / "cube.npy", COUNTS)
    plain = srt3d_ros.reconstruct(tmp_path / "cube.npy", irf_sigma_bins=2)
    assert [note.split()[0] for note in plain.notes] == ["bin", "geometry"] and len(plain) == 240
    np.savez(tmp_path / "a.npz", rows=12, cols=20, num_bins=300, pixel=FRAME.pixel, toa=FRAME.toa * 5e-11, stamp_ns=7)
    with pytest.raises(srt3d_ros.InvalidInput, match="^a.npz: All toa are below 1.*divide seconds"):
        srt3d_ros.read(tmp_path / "a.npz", bin_width_s=5e-11)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_takes_events_and_counts(name):
    by_events = PHOTONS.reconstruct(method=name, device="cpu")
    by_counts = srt3d_ros.reconstruct(COUNTS, sensor=SENSOR, method=name)
    same(by_counts, by_events)
    assert by_events.method == name and len(by_events) > 230
    assert (by_events.sketch_ms is None) == (METHODS[name].needs == "photons")


def test_options_reach_sketch_and_method(cloud):
    given = PHOTONS.reconstruct(frequencies=np.array([1, 5, 2]), surfaces=2, background="flat", false_alarm_rate=0.01)
    assert given.frequencies == (1, 5, 2) and given.surfaces == 2
    assert not np.array_equal(given.background, cloud.background)
    assert PHOTONS.sketch(4, frequencies="consecutive").frequencies == (1, 2, 3, 4)


@pytest.mark.parametrize("method, source", [("pooled", COUNTS), ("xcorr", FRAME)], ids=["pooled", "xcorr"])
def test_a_gate_drops_what_lies_outside_and_says_so(cloud, method, source):
    gated = srt3d_ros.reconstruct(source, sensor=SENSOR, gate=(60, 130), method=method)
    assert gated.sensor.num_bins == 71 and gated.sensor.toa_offset_bins == 1060
    inside = np.count_nonzero((FRAME.toa >= 60) & (FRAME.toa <= 130))
    assert gated.photons == inside
    assert gated.notes == (f"{FRAME.photons - inside} of {FRAME.photons} photons lie outside the gate "
                           "(bins 60 to 130): dropped",)
    assert np.median(gated.xyz[:, 2]) == pytest.approx(np.median(cloud.xyz[:, 2]), abs=SENSOR.bin_width_m)


def test_what_is_assumed_is_noted_and_shown():
    said = srt3d_ros.from_events(ROW, COL, FRAME.toa, **ARRAYS).reconstruct()
    assert (said.notes, len(said), said.sensor.num_bins) == ((), 240, 300) and said.sensor.same_as(SENSOR.replace(
        toa_offset_bins=0, projection=Pinhole.from_fov(12, 20, 20)))
    photons = srt3d_ros.from_events(ROW, COL, FRAME.toa, **ARRAYS | {"irf": None, "fov_deg": None})
    cloud = photons.reconstruct()
    assert [note.split()[0] for note in cloud.notes] == ["IRF", "geometry"]
    number = f"{FRAME.photons:,}"
    assert repr(SENSOR) == "Sensor of 12 × 20 pixels, 300 bins of 50 ps from 7.495 m on, IRF of 21 bins, pinhole"
    assert repr(photons) == f"Photons of arrays: {number} in 12 × 20 pixels and 300 bins; 2 notes"
    assert repr(photons.sketch(4)) == f"Sketch of {number} photons, 4 numbers in each of 12 × 20 pixels; 2 notes"
    assert repr(cloud).startswith("Cloud of 240 points at 0.")
    assert repr(cloud).endswith(f"from {number} photons of 12 × 20 pixels; 2 notes")


# ---- Sketches

def test_what_is_said_wins_over_the_sensor_of_a_sketch():
    sketch = PHOTONS.sketch(gate=(60, 130))
    other = SENSOR.replace(num_bins=71, projection=Pinhole(50, 50, 9, 9), irf=[1, 2, 1], irf_ref=None)
    seen = srt3d_ros.read(sketch, sensor=other)
    assert seen.sensor.same_as(other) and seen.notes == (*sketch.notes, "as given, not as in the file: irf, "
                                                         "toa_offset_bins, projection")
    with pytest.raises(srt3d_ros.InvalidInput, match="^num_bins is 300: expected 71, as in the file"):
        srt3d_ros.reconstruct(sketch, sensor=SENSOR)


def test_sums_of_any_type_give_the_same_cloud_and_what_is_no_sketch_is_refused():
    sketch = PHOTONS.sketch()
    for sums in (sketch.sums.astype(complex), sketch.sums.tolist()):
        other = srt3d_ros.Sketch(list(sketch.frequencies), sums, sketch.photons.astype(float), sensor=SENSOR)
        same(other.reconstruct(), sketch.reconstruct())
    fields = vars(sketch) | {"notes": ()}
    for changes, said in (({"sums": sketch.sums.real}, "sums is float32 .*complex"), ({"sensor": None}, "sensor is "),
                          ({"sums": [[1j], [1j, 2j]]}, "sums is list"), ({"frequencies": 3}, "frequencies is int64"),
                          ({"photons": sketch.photons - 0.5}, "photons is negative or fractional"),
                          ({"photons": sketch.photons[:3], "sums": sketch.sums[:3]}, "photons shape is .*sensor's")):
        with pytest.raises(srt3d_ros.InvalidInput, match=f"^{said}"):
            srt3d_ros.Sketch(**fields | changes)


def test_a_reconstructor_follows_a_stream_of_sketches_until_it_forgets():
    sketch = PHOTONS.sketch()
    reconstructor = srt3d_ros.Reconstructor(SENSOR, sketch.frequencies, device="cpu")
    same(reconstructor(sketch), sketch.reconstruct(device="cpu"))
    plain = sketch_photons(FRAME, SENSOR, sketch.frequencies)
    assert reconstructor(plain).photons == FRAME.photons
    reconstructor.forget()
    same(reconstructor(plain), sketch.reconstruct(device="cpu"))
    by_photons = srt3d_ros.Reconstructor(SENSOR, method="xcorr")
    same(by_photons(FRAME), PHOTONS.reconstruct(method="xcorr"))
    by_photons.forget()


def test_sketches_of_parts_add_to_that_of_all():
    half = FRAME.photons // 2
    parts = [srt3d_ros.read(FRAME.part(part), sensor=SENSOR).sketch(frequencies=FREQUENCIES)
             for part in (slice(half), slice(half, None))]
    whole = PHOTONS.sketch(frequencies=FREQUENCIES)
    total = sum(parts)
    assert isinstance(total, srt3d_ros.Sketch) and np.array_equal(total.photons, whole.photons)
    np.testing.assert_allclose(total.sums, whole.sums, atol=1e-3)
    said = r"^Cannot add sketches of different sensors \(toa_offset_bins 1000.0 and 0.0\)\.$"
    with pytest.raises(srt3d_ros.InvalidInput, match=said):
        parts[0] + srt3d_ros.read(PHOTONS, toa_offset_bins=0).sketch(frequencies=FREQUENCIES)


def test_a_part_of_a_sketch_sees_its_part_of_the_scene_also_before_the_sensor(cloud):
    part = PHOTONS.sketch()[3:9, 5:].reconstruct()
    assert (part.sensor.rows, part.sensor.cols) == (6, 15) and len(part) == 90
    chosen = (cloud.row >= 3) & (cloud.row < 9) & (cloud.col >= 5)
    np.testing.assert_allclose(part.xyz, cloud.xyz[chosen], atol=2 * SENSOR.bin_width_m)
    assert len(PHOTONS.sketch()[2:4].reconstruct()) == 40
    behind = srt3d_ros.read(PHOTONS, toa_offset_bins=-400).reconstruct()
    assert np.nanmax(behind.range_image()) < -2         # before the sensor


# ---- What a cloud can do

def test_a_cloud_is_drawn(cloud):
    from matplotlib.figure import Figure

    image = cloud.render()
    assert (image.shape, image.dtype) == ((900, 1200, 3), np.uint8)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 100
    left, right = (cloud.render(yaw_deg=yaw_deg, size_px=(300, 200)) for yaw_deg in (-20, 20))
    assert left.shape == (200, 300, 3) and not np.array_equal(left, right)
    axes = Figure().subplots()
    assert cloud.plot(ax=axes) is axes and np.array_equal(axes.images[0].get_array(), image)
    assert isinstance(cloud.plot(yaw_deg=0), type(axes))
    quantities = "range", "intensity", "depth_std", "snr"
    assert len({cloud.render(name, size_px=(300, 200)).tobytes() for name in quantities}) == 4
    wrong = ({"size_px": (0, 9)}, r"size_px is \(0, 9\)"), ({"colour_by": "hue"}, "colour_by is .hue")
    for options, expected in wrong:
        with pytest.raises(srt3d_ros.InvalidInput, match=f"^{expected}"):
            cloud.render(**options)
    with pytest.raises(srt3d_ros.InvalidInput, match=r"^The points have no depth_std: "):
        replace(cloud, method="rt3d", depth_std_bins=np.full(len(cloud), np.nan, np.float32)).plot("depth_std")


def test_the_first_call_shows_that_it_compiles(repository):
    """A small kernel that is never on the disk stands for all kernels."""
    code = ("from srt3d_ros.progress import compiling\n"
            "def kernel(x): return x + 1\nkernel.__module__ = 'srt3d_ros.kernels.cpu.made_up'\n"
            "kernel = __import__('numba').njit(kernel)\nwith compiling(): kernel(1)\n")
    done = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True)
    assert done.stderr.count("compiling kernels (`srt3d compile`") == 2, done.stderr
    assert f"1/{FIRST_KERNELS}" in done.stderr, done.stderr


# ---- What is refused

@pytest.mark.parametrize(("source", "options", "said"), [
    (3, {}, "source is int: expected one path .*, an array of counts, Photons or a Sketch"),
    (["a.npz", "b.npz"], {}, r"source is list of 2 paths: expected one path \(read several in a loop\)"),
    (FRAME, {"irff": [1]}, 'option name is "irff": expected one of shape, rows, cols, '),
    (FRAME, {"frame": 2}, "frame 2: only a bag or a log has one"),
    (FRAME, {"frequencies": [1.5]}, "frequencies is 1.5: "), (FRAME, {"shape": 12}, "shape is 12"),
    (FRAME, {"sensor": 5}, "sensor is int: expected a Sensor"),
    (FRAME, {"method": "smle", "background": "flat"}, "background flat: smle takes only surfaces, device"),
    (FRAME, {"sketch_size": "ten"}, 'sketch_size is "ten"'), (FRAME, {"false_alarm_rate": "x"}, "false_alarm_rate is "),
    (FRAME, {"projection": "pinhole"}, 'projection is "pinhole"'), (FRAME, {"stamp_ns": 1}, "option name is "),
    (FRAME, {"irf": 2}, "irf shape is .*irf_sigma_bins makes a Gaussian"),
    ("absent.npz", {"photons_topic": "/photons"}, "Only bags have topics"),
    (FRAME, {"method": "rt3d", "sketch_size": 5}, "rt3d works on all times of arrival and takes no sketch_size"),
    ("SKETCH", {"gate": "auto"}, "gate auto: the sketch is already made"),
    ("SKETCH", {"method": "rt3d"}, "method is rt3d: expected one that takes sketches: pooled, srt3d, smle"),
])
def test_a_mistake_is_one_line(source, options, said):
    source = PHOTONS.sketch() if isinstance(source, str) and source == "SKETCH" else source
    with pytest.raises(srt3d_ros.InvalidInput, match=f"^{said}"):
        srt3d_ros.reconstruct(source, **{"sensor": SENSOR} | options)


@pytest.mark.parametrize(("call", "said"), [
    (lambda cloud: srt3d_ros.reconstruct(FRAME), r"Give shape=\(rows, cols\), or sensor"),
    (lambda cloud: cloud.image("foo"), "field is foo: expected depth_bins or "),
    (lambda cloud: cloud.image("intensity", "a"), 'surface is "a"'), (lambda cloud: cloud.save(3), "output is int"),
    (lambda cloud: srt3d_ros.Reconstructor("a", (1, 2)), "sensor is str"),
    (lambda cloud: srt3d_ros.Reconstructor(SENSOR, 3), "frequencies is "),
    (lambda cloud: srt3d_ros.Reconstructor(SENSOR), "pooled reads sketches: give their frequencies"),
    (lambda cloud: srt3d_ros.Reconstructor(SENSOR, (1, 2))(PHOTONS), "seen is Photons: expected a Sketch")])
def test_a_wrong_type_is_one_line(cloud, call, said):
    with pytest.raises(srt3d_ros.InvalidInput, match=f"^{said}"):
        call(cloud)


# ---- The package

def test_the_package_shows_its_names():
    assert sorted(srt3d_ros.__all__) == sorted(api.__all__) and set(api.__all__) <= set(dir(srt3d_ros))
    assert srt3d_ros.reconstruct is api.reconstruct
    with pytest.raises(AttributeError, match="no attribute 'magic'"):
        srt3d_ros.magic


def test_options_are_listed_by_name_with_the_defaults_of_their_table():
    written = inspect.signature(srt3d_ros.reconstruct).parameters
    assert all(written[name].default == key.default for name, key in keys(MethodOptions).items())
    for one in (srt3d_ros.reconstruct, srt3d_ros.Photons.reconstruct, srt3d_ros.Sketch.reconstruct,
                srt3d_ros.Reconstructor, srt3d_ros.read, srt3d_ros.from_events):
        shown = inspect.signature(one).parameters
        assert all(argument.kind is not argument.VAR_KEYWORD for argument in shown.values())
        assert keys(MethodOptions).keys() <= shown.keys() or {"num_bins", "irf", "channel"} <= shown.keys()
    assert "false_alarm_rate: fraction of the pixels" in srt3d_ros.Photons.reconstruct.__doc__
