"""RecordingWriter: what is logged is in the file, and whatever happens to the file, the caller goes on."""

import contextlib
import os
import subprocess
import sys
import threading
import time
import warnings
from dataclasses import replace

import numpy as np
import pytest
from rerun.chunk import RrdReader

from srt3d_ros.colours import packed, range_table, visible_table
from srt3d_ros.core.distortion import PlumbBob
from srt3d_ros.errors import InvalidInput
from srt3d_ros.recording import schema
from srt3d_ros.recording import writer as writer_module
from srt3d_ros.recording.frame_log import Colouring, Style
from srt3d_ros.recording.reader import RecordingReader
from srt3d_ros.recording.rrd_file import RrdFile
from srt3d_ros.recording.writer import RecordingWriter


def random_cloud(points, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(points, 3)).astype(np.float32), rng.gamma(2, 5, points).astype(np.float32)


def rows(xyz, *columns):
    """The points as bytes, sorted: equal for the same points in any order."""
    table = np.column_stack([xyz, *columns]).astype(np.float32)
    return sorted(map(bytes, table))


def record_clouds(path, clouds, sensor, **options):
    with RecordingWriter(path, sensor, **options) as writer:
        for k, (xyz, intensity) in enumerate(clouds):
            writer.log_cloud(10**18 + k, 7 * k, xyz, intensity)
    assert writer.error is None and writer.dropped == 0
    read = sorted(RecordingReader(path).clouds(), key=lambda cloud: cloud.frame_index)
    assert [(c.stamp_ns, c.frame_index) for c in read] == [(10**18 + k, 7 * k) for k in range(len(clouds))]
    return read


def test_positions_are_kept_bit_for_bit_and_intensities_in_11_bits_whatever_their_order(tmp_path, ball):
    clouds = [random_cloud(n, seed=n) for n in (1000, 1, 0, 20_000)]
    clouds[0][0][3] = np.nan
    clouds[0][1][5] = np.nan
    clouds.append((clouds[3][0], clouds[3][1] * 10_000))        # beyond the largest float16
    for cloud, (xyz, intensity) in zip(record_clouds(tmp_path / "a.rrd", clouds, ball[1]), clouds, strict=True):
        assert rows(cloud.xyz) == rows(xyz)
        rounded = intensity.astype(np.float16) if np.nanmax(intensity, initial=0) < 65_504 else intensity
        assert rows(cloud.xyz, cloud.intensity) == rows(xyz, rounded)
        assert np.allclose(rounded, intensity, rtol=2**-11, atol=0, equal_nan=True)


def test_row_column_surface_and_deviation_stay_with_their_point(tmp_path, ball):
    cloud, sensor = ball
    std_m = cloud.depth_std_bins * sensor.bin_width_m
    with RecordingWriter(tmp_path / "a.rrd", sensor) as writer:
        writer.log_cloud(0, 0, cloud.xyz, cloud.intensity, depth_std=std_m, row=cloud.row, col=cloud.col,
                         surface=cloud.surface)
    (read,) = RecordingReader(tmp_path / "a.rrd").clouds()
    assert (read.row.dtype, read.col.dtype, read.surface.dtype) == (np.uint16, np.uint16, np.uint8)
    order, read_order = (np.lexsort((c.surface, c.col, c.row)) for c in (cloud, read))
    assert np.array_equal(read.xyz[read_order], cloud.xyz[order])
    assert np.array_equal(read.depth_std_m[read_order], std_m[order].astype(np.float16))


def test_points_cost_fourteen_bytes_and_a_photon_image_a_few_bits(tmp_path):
    """12 of them for the position: sorted, intensities and colours compress to 1.9 of 6."""
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(60_000, 3)).astype(np.float32)
    intensity = rng.gamma(8, 2, 60_000).astype(np.float32)
    sizes = []
    for log in (lambda writer: None, lambda writer: writer.log_cloud(0, 0, xyz, intensity),
                lambda writer: writer.log_image(schema.BACKGROUND, 0, 0, intensity.reshape(200, 300)),
                lambda writer: writer.log_image(schema.PHOTONS, 0, 0, rng.poisson(intensity.reshape(200, 300)))):
        with RecordingWriter(tmp_path / "a.rrd", None) as writer:
            log(writer)
        sizes.append((tmp_path / "a.rrd").stat().st_size)
    empty, cloud, background, photons = sizes
    assert (cloud - empty) / 60_000 < 14
    assert (background - empty) / 60_000 < 1.4 and (photons - empty) / 60_000 < 1.3


def test_arrays_may_be_reused_after_logging_and_need_not_be_contiguous(tmp_path):
    xyz, records, image = (np.zeros(shape, np.float32) for shape in ((500, 3), (500, 4), (20, 30)))
    with RecordingWriter(tmp_path / "a.rrd", None) as writer:
        for k in range(2):
            xyz[:], records[:], image[:] = k, k, k
            writer.log_cloud(2 * k, k, xyz, records[:, 3])
            writer.log_cloud(2 * k + 1, k, records[:, :3], xyz[:, 0])
            writer.log_depth(k, k, image)
        xyz[:], records[:], image[:] = 99, 99, 99
    reader = RecordingReader(tmp_path / "a.rrd")
    assert [(cloud.xyz == cloud.frame_index).all() for cloud in reader.clouds()] == [True] * 4
    assert [(cloud.intensity == cloud.frame_index).all() for cloud in reader.clouds()] == [True] * 4
    assert [(depth_m == k).all() for _, k, depth_m in reader.images("/depth")] == [True] * 2


@pytest.mark.parametrize("by, values", [
    ("height", lambda xyz: -xyz[:, 1]), ("range", lambda xyz: np.linalg.norm(xyz, axis=1)),
    ("depth_std", lambda xyz: xyz[:, 0] ** 2)])
def test_colours_show_the_chosen_quantity_over_the_chosen_range(tmp_path, by, values):
    xyz, intensity = random_cloud(1000)
    style = Style(Colouring(by, "viridis", fixed_range=(0.5, 2.0)))
    with RecordingWriter(tmp_path / "a.rrd", None, style=style) as writer:
        writer.log_cloud(0, 0, xyz, intensity, depth_std=xyz[:, 0] ** 2)
        writer.log_cloud(1, 1, 2 * xyz, intensity, depth_std=4 * xyz[:, 0] ** 2)
    table = packed((range_table if by == "range" else visible_table)("viridis"))
    for cloud in RecordingReader(tmp_path / "a.rrd").clouds():
        value = values(cloud.xyz)
        assert set(cloud.colour[value <= 0.5]) == {table[0]}
        assert set(cloud.colour[value >= 2.0]) == {table[255]}
        green = cloud.colour[np.argsort(value)] >> 16 & 255         # rises all along viridis
        assert (np.diff(green.astype(int)) * (-1 if by == "range" else 1) >= 0).all() and len(set(green)) > 30


def test_depth_is_yellow_when_near_and_black_where_there_is_none(tmp_path, ball):
    """The viewer turns its map round for a range that falls, and draws one image over the other."""
    depth_m = ball[0].depth_image(ball[1].projection)
    for in_mm in (False, True):
        far, near = np.array(schema.depth_image(depth_m, 1.0, 1.5, in_mm).depth_range.as_arrow_array()[0].as_py())
        assert (far, near) == pytest.approx(np.array([1.5 + 0.5 * 45 / 210, 1.0]) * (1000 if in_mm else 1))
    with RecordingWriter(tmp_path / "a.rrd", ball[1], images=(schema.DEPTH,)) as writer:
        writer.log_depth(0, 0, depth_m)
    stream = RrdReader(tmp_path / "a.rrd").stream()
    batches = [chunk.to_record_batch() for chunk in stream.filter(content=schema.NO_DEPTH)]
    columns = {name.split(":")[-1]: batch.column(name) for batch in batches for name in batch.schema.names}
    drawn = np.array(columns["buffer"][0].as_py()[0]).reshape(depth_m.shape)
    assert np.array_equal(drawn == 1, np.isnan(depth_m)) and columns["opacity"][0].as_py() == [1.0]
    assert len(columns["context"][0].as_py()[0]) == 2


def test_without_a_depth_std_the_intensity_colours(tmp_path):
    by_std, by_intensity = (record_clouds(tmp_path / "a.rrd", [random_cloud(1000)], None, style=Style(Colouring(by)))
                            for by in ("depth_std", "intensity"))
    assert np.array_equal(by_std[0].colour, by_intensity[0].colour)


@pytest.mark.parametrize("offset_m, error_m", [(0.0, 0.0005 + 1e-6), (9790.0, 0)])
def test_depth_is_kept_to_half_a_millimetre_or_exactly_beyond_65_m(tmp_path, ball, offset_m, error_m):
    cloud, sensor = ball
    image = cloud.range_image() + np.float32(offset_m)
    with RecordingWriter(tmp_path / "a.rrd", sensor.replace(range_offset_m=offset_m)) as writer:
        writer.log_depth(5, 2, image)
    (stamp_ns, frame_index, read), = RecordingReader(tmp_path / "a.rrd").images("/depth")
    assert (stamp_ns, frame_index) == (5, 2)
    assert np.isnan(image).sum() == 12 and (np.isnan(read) == np.isnan(image)).all()
    assert np.nanmax(np.abs(read - image)) <= error_m


def test_photon_images_are_kept_to_a_third_of_their_noise_and_counts_exactly(tmp_path):
    rng = np.random.default_rng(2)
    mean = rng.gamma(2, 50, (30, 40)).astype(np.float32)
    mean[3, 4] = np.nan
    counts = [rng.poisson(9, (30, 40)), np.full((30, 40), 70_000)]
    with RecordingWriter(tmp_path / "a.rrd", None) as writer:
        writer.log_image(schema.INTENSITY_IMAGE, 0, 0, mean)
        for k, count in enumerate(counts):
            writer.log_image(schema.PHOTONS, k, k, count)
    reader = RecordingReader(tmp_path / "a.rrd")
    ((_, _, read),) = reader.images(schema.INTENSITY_IMAGE)
    assert np.isnan(read[3, 4]) and np.isnan(read).sum() == 1
    assert np.nanmax(np.abs(np.sqrt(read.astype(float)) - np.sqrt(mean))) <= 0.175 + 0.01
    read = sorted((image for image in reader.images(schema.PHOTONS)), key=lambda image: image[1])
    assert all(np.array_equal(image, count) for (_, _, image), count in zip(read, counts, strict=True))


def test_scalars_are_complete_under_load_and_every_missing_cloud_is_counted(tmp_path):
    xyz, intensity = random_cloud(20_000)
    frames = 150
    with RecordingWriter(tmp_path / "a.rrd", None, queue_mb=1.3) as writer:
        for k in range(frames):
            writer.log_cloud(k, k, xyz, intensity)
            writer.log_scalars(k, {"latency_ms": k / 7, "points": 20_000 + k, "latency_ms/sketch": k}, k)
    reader = RecordingReader(tmp_path / "a.rrd")
    series = reader.series()
    assert set(series) == {"latency_ms", "points", "latency_ms/sketch"}
    for name, values in (("latency_ms", np.arange(frames) / 7), ("points", 20_000 + np.arange(frames))):
        assert np.array_equal(series[name].stamp_ns, np.arange(frames))
        assert np.array_equal(series[name].values, values)
    assert len(list(reader.clouds())) + writer.dropped == frames
    assert writer.error is None


def test_a_flood_of_clouds_does_not_keep_scalars_from_the_file(tmp_path, monkeypatch):
    """Without regular flushes, rerun writes clouds only."""
    monkeypatch.setattr(writer_module, "FLUSH_PERIOD_S", 0.1)
    xyz, intensity = random_cloud(20_000)
    names = set()
    with RecordingWriter(tmp_path / "a.rrd", None) as writer:
        writer.log_scalars(0, {"points": 1}, 0)
        for k in range(200):
            writer.log_cloud(k, k, xyz, intensity)
            time.sleep(0.01)
            if k >= 50 and k % 10 == 0 and not names:
                (tmp_path / "copy.rrd").write_bytes((tmp_path / "a.rrd").read_bytes())
                with contextlib.suppress(InvalidInput):         # copied in the middle of a chunk: once more
                    names = set(RecordingReader(tmp_path / "copy.rrd").series())
    assert names == {"points"}


def test_flush_puts_everything_into_the_unfinished_file(tmp_path, monkeypatch):
    """Even on a slow disk, when data of rerun is still in the pipe or in our copying thread."""
    write = RrdFile._write
    monkeypatch.setattr(RrdFile, "_write", lambda sink, data: (time.sleep(0.02), write(sink, data)))
    writer = RecordingWriter(tmp_path / "a.rrd", None)
    xyz, intensity = random_cloud(20_000)
    for k in range(5):
        writer.log_cloud(k, k, xyz, intensity)
        writer.log_scalars(k, {"points": k}, k)
    assert writer.flush()
    (tmp_path / "copy.rrd").write_bytes((tmp_path / "a.rrd").read_bytes())      # as kill -9 would leave it
    copy = RecordingReader(tmp_path / "copy.rrd")
    assert not copy.is_finished
    assert len(list(copy.clouds())) == 5 and copy.series()["points"].values.tolist() == [0, 1, 2, 3, 4]
    writer.close()
    assert RecordingReader(tmp_path / "a.rrd").is_finished


def test_a_disk_that_stalls_costs_the_oldest_clouds_and_never_the_caller(tmp_path):
    """The file is a named pipe that nobody empties at first."""
    os.mkfifo(tmp_path / "slow.rrd")
    reading = os.open(tmp_path / "slow.rrd", os.O_RDONLY | os.O_NONBLOCK)
    writer = RecordingWriter(tmp_path / "slow.rrd", None, queue_mb=1)
    xyz, intensity = random_cloud(20_000)
    for _ in range(20):     # until rerun's own buffers are full as well
        writer.log_cloud(0, 0, xyz, intensity)
        time.sleep(0.001)
    writer.flush(timeout_s=0.2)
    before = writer.dropped
    for k in range(50):
        writer.log_cloud(100 + k, 100 + k, xyz, intensity)
    assert writer.dropped - before >= 47
    os.set_blocking(reading, True)
    emptying = threading.Thread(target=lambda: (tmp_path / "a.rrd").write_bytes(open(reading, "rb").read()))
    emptying.start()
    writer.close()
    emptying.join()
    assert writer.error is None
    kept = [cloud.frame_index for cloud in RecordingReader(tmp_path / "a.rrd").clouds()]
    assert kept[-3:] == [147, 148, 149]


def test_a_path_that_cannot_be_written_gives_one_error_and_no_exception(tmp_path):
    errors = []
    with RecordingWriter(tmp_path / "absent" / "a.rrd", None, on_error=errors.append) as writer:
        assert writer.error == f"recording {tmp_path}/absent/a.rrd: No such file or directory"
        for k in range(3):
            writer.log_cloud(k, k, *random_cloud(10))
            writer.log_depth(k, k, np.ones((2, 2)))
            writer.log_scalars(k, {"points": 10}, k)
        assert not writer.flush()
    assert errors == [writer.error]
    assert writer.dropped == 6


def test_a_process_that_forgets_to_close_ends_with_a_finished_file(tmp_path):
    script = """
import sys
import numpy as np
from srt3d_ros.recording.writer import RecordingWriter
writer = RecordingWriter(sys.argv[1], None)
for k in range(30):
    writer.log_cloud(k, k, np.ones((20_000, 3)), np.ones(20_000))
"""
    subprocess.run([sys.executable, "-c", script, tmp_path / "a.rrd"], timeout=60, check=True)
    reader = RecordingReader(tmp_path / "a.rrd")
    assert reader.is_finished and len(list(reader.clouds())) == 30


def test_closing_twice_and_logging_afterwards_change_nothing(tmp_path):
    writer = RecordingWriter(tmp_path / "a.rrd", None)
    writer.log_scalars(3, {"drops": 1, "points": None})
    writer.log_scalars(4, {"drops": np.int64(2), "points": float("nan")}, 9)
    writer.close()
    size = (tmp_path / "a.rrd").stat().st_size
    writer.log_cloud(1, 1, *random_cloud(10))
    writer.log_scalars(1, {"points": 2})
    writer.close()
    series = RecordingReader(tmp_path / "a.rrd").series()
    assert series["drops"].values.tolist() == [1, 2] and series["drops"].stamp_ns.tolist() == [3, 4]
    assert len(series["points"].values) == 1 and np.isnan(series["points"].values[0])
    assert writer.error is None and writer.dropped == 1
    assert (tmp_path / "a.rrd").stat().st_size == size


def test_properties_hold_the_run_and_the_sensor(tmp_path, ball):
    sensor = ball[1].replace(projection=replace(ball[1].projection, distortion=PlumbBob(k1=-0.05, p2=0.01)))
    facts = {"version": "1.2", "frequencies": [1, 2, 5], "nothing": None, "path": tmp_path, "rate_hz": 10.0,
             "live": True}
    with RecordingWriter(tmp_path / "a.rrd", sensor, properties={"run": facts, "versions": {"numpy": "2"}}) as writer:
        writer.set_properties("parameters", {"sketcher.sketch_size": 5, "sketcher.layout": "float32"})
        writer.set_properties("parameters", {"sketcher.sketch_size": 6})
    properties = RecordingReader(tmp_path / "a.rrd").properties()
    run = properties["run"]
    assert run["frequencies"].tolist() == [1, 2, 5] and run["path"] == str(tmp_path) and "nothing" not in run
    assert properties["versions"] == {"numpy": "2"}
    assert properties["parameters"] == {"sketcher.sketch_size": 6, "sketcher.layout": "float32"}
    assert (run["version"], run["rate_hz"], run["live"]) == ("1.2", 10.0, True)
    assert properties["sensor"]["rows"] == 40 and properties["sensor"]["bin_width_s"] == 20e-12
    assert properties["sensor"]["projection"] == "pinhole" and properties["sensor"]["fx"] == sensor.projection.fx
    assert properties["sensor"]["distortion"].tolist() == [-0.05, 0, 0, 0.01, 0]
    assert np.array_equal(properties["sensor"]["irf"].astype(np.float32), sensor.irf)


def test_a_property_without_facts_is_left_out_without_a_warning(tmp_path):
    """Such as the parameters of a node that has ended."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        with RecordingWriter(tmp_path / "a.rrd", None, properties={"versions": {}}) as writer:
            writer.set_properties("parameters", {"unset": None, "none": [], "nothing": ()})
    assert not [str(warning.message) for warning in seen]
    assert not {"versions", "parameters"} & RecordingReader(tmp_path / "a.rrd").properties().keys()
