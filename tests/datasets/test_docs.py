"""docs/photon-file.md describes what the code reads."""

import re

from srt3d_ros.datasets import photon_file
from srt3d_ros.datasets.readers.mat import LAYOUTS


def test_every_array_and_layout_is_described(repository):
    text = (repository / "docs" / "photon-file.md").read_text(encoding="utf-8")
    for name in (*photon_file.KNOWN, *(layout.variable for layout in LAYOUTS)):
        assert f"`{name}`" in text or re.fullmatch(r"ref_depth_bins_[3-8]", name), name
