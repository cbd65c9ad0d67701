"""The page of an evaluation."""

import sys

from srt3d_ros.evaluation import report
from srt3d_ros.evaluation.results import averaged
from tests.evaluation.test_results import ROW


def test_without_matplotlib_there_are_the_table_and_a_note(tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.startswith(("srt3d_ros.pictures", "srt3d_ros.evaluation.fig"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    notes = ["one"]
    report.write(tmp_path, averaged([ROW]), [], notes, "srt3d evaluate")
    assert notes == ["one", report.NO_FIGURES]
    page = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "| bust " in page and report.NO_FIGURES in page and "![" not in page
