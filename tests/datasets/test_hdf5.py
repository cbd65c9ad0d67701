"""HDF5, Photon-HDF5 and MATLAB 7.3 files, read with h5py in a child process."""

from importlib.util import find_spec

import numpy as np
import pytest
from scipy.io import savemat

from srt3d_ros import read
from srt3d_ros.datasets.readers.hdf5 import TOA
from srt3d_ros.errors import InvalidInput
from tests.datasets import laboratory_files as files

h5py = pytest.importorskip("h5py")
IRF = [1.0, 3.0, 1.0]
CUBE = files.pulse_cube()


@pytest.fixture(autouse=True)
def in_a_child_where_it_matters(request):
    if "cannot" not in request.node.name:
        request.getfixturevalue("in_this_process")


def write(path, **arrays):
    return files.write(path, arrays)


def spot(toa, detectors=None, laser_hz=2e7) -> dict:
    """The arrays of a group `photon_data`, in bins of 100 ps."""
    specs = {"nanotimes_specs/tcspc_unit": 1e-10, "nanotimes_specs/tcspc_num_bins": 4096,
             "measurement_specs/laser_repetition_rate": laser_hz}
    return specs | {"nanotimes": np.array(toa, np.uint16), "timestamps": np.arange(len(toa)),
                    "detectors": np.array(detectors or [0] * len(toa), np.uint8)}


def photon_hdf5(path, **arrays):
    return write(path, **{f"photon_data/{name}": values for name, values in arrays.items()})


def test_the_only_cube_of_an_hdf5_file_is_read_from_any_group(tmp_path):
    arrays = {"scan/hist": CUBE, "scan/mean": CUBE.mean(axis=2), "bin_width_s": 2e-10, "irf": IRF, "title": "a text",
              "toa_offset_bins": 0.0}
    photons = read(write(tmp_path / "a.h5", **arrays), fov_deg=9)
    expected = read(write(tmp_path / "b.hdf5", a=np.asfortranarray(CUBE.astype(">f8"))), irf=IRF, bin_width_s=2e-10)
    assert photons.sensor.same_as(expected.sensor.replace(projection=photons.sensor.projection))
    assert photons.notes == () and photons.photons == CUBE.sum()
    np.testing.assert_array_equal(photons.frame.pixel, expected.frame.pixel)
    np.testing.assert_array_equal(photons.frame.toa, expected.frame.toa)


def test_photon_hdf5_is_a_pixel_and_t_is_the_period_of_the_laser(tmp_path):
    path = photon_hdf5(tmp_path / "a.h5", **spot([7, 8, 9], [0, 1, 1]))
    photons = read(path, irf=IRF)
    assert (photons.sensor.pixels, photons.sensor.num_bins, photons.sensor.bin_width_s) == (1, 500, 1e-10)
    assert (photons.frame.pixel.tolist(), photons.frame.toa.tolist()) == ([0] * 3, [7, 8, 9])
    assert read(path, irf=IRF, channel=1).frame.toa.tolist() == [8, 9]
    with pytest.raises(InvalidInput, match="^a.h5 channel is 7: expected one of 0, 1"):
        read(path, irf=IRF, channel=7)


def test_of_several_spots_one_is_read_by_name(tmp_path):
    path = write(tmp_path / "a.h5", **{f"photon_data{k}/{TOA}": np.array([k], np.uint16) for k in (3, 4)})
    options = {"irf": IRF, "num_bins": 9, "bin_width_s": 1e-10}
    assert read(path, columns=f"photon_data4/{TOA}", **options).frame.toa.tolist() == [4]
    with pytest.raises(InvalidInput, match="^a.h5: The file needs Photon-HDF5 with .* It has photon_data3/nanotimes"):
        read(path, **options)


def test_detectors_are_pixels_if_they_are_named(tmp_path):
    path = photon_hdf5(tmp_path / "a.h5", **spot([4, 5, 4095], [0, 5, 2], laser_hz=1e6))
    photons = read(path, irf=IRF, shape=(2, 3), num_bins=4096, columns="detectors,nanotimes")
    assert (photons.frame.pixel.tolist(), photons.frame.toa.tolist()) == ([0, 5, 2], [4, 5, 4095])
    with pytest.raises(InvalidInput, match="^a.h5: To make each detector a pixel, give columns=detectors,nanotimes"):
        read(path, irf=IRF, shape=(2, 3))


def test_the_arrays_of_photon_hdf5_may_be_in_no_group(tmp_path):
    arrays = {"nanotimes": np.array([4, 5, 6], np.int16), "detectors": np.array([0, 1, 1], np.uint8)}
    path = write(tmp_path / "a.h5", **arrays, timestamps=np.arange(3))
    options = {"irf": IRF, "num_bins": 9, "bin_width_s": 1e-10}
    assert read(path, **options).frame.toa.tolist() == [4, 5, 6]
    assert read(path, channel=1, **options).frame.toa.tolist() == [5, 6]
    with pytest.raises(InvalidInput, match="^a.h5: The file has no num_bins"):
        read(path, irf=IRF)


def test_columns_may_be_those_of_a_table(tmp_path):
    table = np.array([(0, 2, 7, b"a"), (1, 0, 8, b"b"), (1, 2, 9, b"c")],
                     [("y", "u1"), ("x", ">u2"), ("tac", "u4"), ("name", "S1")])
    path = write(tmp_path / "a.h5", **{"spc/photons": table, "spc/_i_photons/y/sorted": np.ones((1, 3))})
    options = {"irf": IRF, "num_bins": 20, "bin_width_s": 1e-10}
    three = read(path, columns="spc/photons/y,spc/photons/x,spc/photons/tac", shape=(2, 3), **options)
    two = read(path, columns="spc/photons/x,spc/photons/tac", shape=(1, 3), **options)
    one = read(path, columns="spc/photons/tac", **options)
    assert three.frame.toa.tolist() == two.frame.toa.tolist() == one.frame.toa.tolist() == [7, 8, 9]
    assert (three.frame.pixel.tolist(), two.frame.pixel.tolist()) == ([2, 3, 5], [2, 0, 2])
    assert one.sensor.pixels == 1
    with pytest.raises(InvalidInput, match=r"It has spc/photons/y \(3 uint8\), spc/photons/x \(3 >u2\)") as refused:
        read(path, **options)
    assert "_i_" not in str(refused.value)


@pytest.mark.parametrize("variables", [
    {"h": CUBE, "irf": np.array(IRF), "bin_width_s": 1e-10},
    {"Y": CUBE.reshape(48, 120).T.copy(), "DepthImage": np.ones((6, 8))},
    {"row": [0, 1, 1], "col": [2, 0, 2], "toa": [5.0, 6, 9], "rows": 2, "cols": 3, "num_bins": 20}])
def test_matlab_7_3_gives_what_matlab_5_does(tmp_path, variables):
    arrays = {name: np.atleast_1d(value) for name, value in variables.items()}
    files.matlab_7_3(tmp_path / "new.mat", **arrays)
    savemat(tmp_path / "old.mat", arrays)
    new, old = (read(tmp_path / name, irf=IRF, toa_offset_bins=1) for name in ("new.mat", "old.mat"))
    assert new.sensor.same_as(old.sensor) and new.notes == old.notes and new.photons > 0
    np.testing.assert_array_equal(new.frame.pixel, old.frame.pixel)
    np.testing.assert_array_equal(new.frame.toa, old.frame.toa)
    np.testing.assert_array_equal(new.reference_depth_bins, old.reference_depth_bins)


def kept_elsewhere(path):
    np.save(path.with_name("secret.npy"), CUBE)
    with h5py.File(path, "w") as file:
        file.create_dataset("a", CUBE.shape, np.uint16, external=[(path.with_name("secret.npy"), 128, CUBE.nbytes)])


def huge(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (2**16, 2**16, 2**10), np.uint16, chunks=(8, 8, 8))


def packed_by_blosc(path):
    with h5py.File(path, "w") as file:
        created = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        created.set_chunk((4, 4, 4))
        created.set_filter(32001, h5py.h5z.FLAG_OPTIONAL)
        h5py.h5d.create(file.id, b"a", h5py.h5t.NATIVE_UINT16, h5py.h5s.create_simple((4, 4, 4)), dcpl=created)


def cut_off(path):
    write(path, a=CUBE)
    path.write_bytes(path.read_bytes()[:3000])


@pytest.mark.parametrize(("name", "make", "said"), [
    ("a.h5", kept_elsewhere, "a.h5 is unreadable .ValueError: a keeps its numbers in another file"),
    pytest.param("a.h5", packed_by_blosc, r"a.h5 is unreadable \(ValueError: pip install hdf5plugin to unpack a\)",
                 marks=pytest.mark.skipif(find_spec("hdf5plugin") is not None, reason="hdf5plugin is installed")),
    ("a.h5", huge, "a.h5: The arrays take more than .* bytes"),
    ("a.h5", cut_off, r"a.h5 is unreadable \(OSError: .*\): expected a complete HDF5 file"),
    ("a.mat", lambda path: path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(900)),
     r"a.mat is unreadable \(OSError: .*\): expected a complete MATLAB .mat file"),
    ("a.h5", lambda path: write(path, x=np.ones((3, 4)), **{"b/c": np.ones(5)}, n=7),
     r"a.h5: The file needs Photon-HDF5.* --columns.* It has b/c \(5 float64\), n \(int64\), x \(3×4 float64\)\."),
    ("a.h5", lambda path: write(path, photon_data=np.ones(5)), "a.h5: The file needs Photon-HDF5")])
def test_what_cannot_be_read_is_one_line(tmp_path, name, make, said):
    make(tmp_path / name)
    with pytest.raises(InvalidInput, match=f"^{said}") as refused:
        read(tmp_path / name, irf=IRF)
    assert str(refused.value).isprintable()
