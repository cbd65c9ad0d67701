"""docs/photon-file.md says what the code does."""

import re

import numpy as np

from srt3d_ros.datasets import mat, npz, open_photons, options


def test_the_snippet_writes_a_photon_file(repository, tmp_path, monkeypatch):
    text = (repository / "docs" / "photon-file.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(re.search(r"```python\n(.*?)```", text, re.DOTALL)[1], {})
    photons = open_photons("photons.npz")
    assert photons.frame.photons == 32 * 32 * 20 and photons.sensor.irf_ref == 1
    assert (photons.reference_depth_bins == 60).all()
    assert np.bincount(photons.frame.toa).argmax() == 60


def test_every_array_option_and_layout_is_described(repository):
    text = (repository / "docs" / "photon-file.md").read_text(encoding="utf-8")
    for name in (*npz.KNOWN, *options.NAMES, *(layout.variable for layout in mat.LAYOUTS)):
        assert f"`{name}`" in text or re.fullmatch(r"ref_depth_bins_[3-8]", name), name
