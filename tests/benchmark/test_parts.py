"""Each part measures all that it promises, on tiny frames, and its table says what follows."""

import dataclasses

import pytest

from srt3d_ros.benchmark import figure1, sketching, table1


def lines_of(part, plan, bar, notes):
    return list(part.measure(plan, bar, notes.append))


def cells_of(text: str) -> list[list[str]]:
    """The cells of a table's rows, without its heading."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]]


def test_table_1_has_every_size_and_sketch_size(tiny, bar, notes):
    lines = lines_of(table1, tiny, bar, notes)
    assert {(line["method"], line["rows"], line["sketch_size"]) for line in lines} == {
        (method, side, m) for method in ("pooled", "srt3d") for side in (12, 16) for m in (5, 10)}
    assert bar.n == table1.steps(tiny) and not notes
    for line in lines:
        assert line["repeats"] == 2 and line["device"] == "cpu" and line["frame_from"] == "host"
        assert line["frames_per_s"] == pytest.approx(1e3 / line["ms"]["median"], rel=0.01, abs=0.06)
        assert line["growth_bytes"] < line["process_peak_bytes"]


def test_table_1_stands_beside_the_papers_times():
    line = {"rows": 705, "sketch_size": 10, "method": "pooled", "device": "cpu", "frame_from": "host",
            "ms": {"min": 500.0, "median": 512.3, "max": 600.0}, "frames_per_s": 1.95, "growth_bytes": 200_000_000,
            "process_peak_bytes": 1_234_000_000}
    small = line | {"rows": 12, "sketch_size": 5, "paper_ms": None, "growth_bytes": None}
    first, second = cells_of(table1.table([line | {"paper_ms": table1.PAPER_MS[705, 10]}, small]))
    assert second == ["705²", "10", "pooled", "cpu", "host", "500", "512", "600", "88", "1.95", "200", "1234"]
    assert first[0] == "12²" and first.count("–") == 2


def test_figure_1_has_every_method_at_every_number_of_photons(tiny, bar, notes):
    *lines, flatness = lines_of(figure1, tiny, bar, notes)
    methods = {*figure1.METHOD_NAMES, "sketching"}
    assert {(line["method"], line["ppp"]) for line in lines} == {(m, ppp) for m in methods for ppp in (1, 10)}
    assert all(line["repeats"] == 2 for line in lines) and not notes
    assert flatness["what"] == "flatness" and flatness["ppps"] == [1, 10] and flatness["max_over_min"] >= 1
    assert bar.n == figure1.steps(tiny)
    held = {(line["method"], line["ppp"]): line.get("input_bytes") for line in lines}
    photons = next(line["photons"] for line in lines if line["ppp"] == 10)
    assert held["rt3d", 10] == photons * (4 + 2)                                # pixel and time of arrival
    assert held["xcorr", 1] == held["xcorr", 10] == 2 * 12 * 12 * 4613
    assert held["pooled", 1] == held["pooled", 10] == 12 * 12 * (10 * 8 + 4)


def test_a_method_that_is_too_slow_is_not_run_on_more_photons(tiny, bar, notes, monkeypatch):
    monkeypatch.setattr(figure1, "METHOD_NAMES", ("rt3d", "pooled"))
    lines = lines_of(figure1, dataclasses.replace(tiny, limit_s=0.0), bar, notes)
    timed = [(line["method"], line["ppp"]) for line in lines if line["what"] == "reconstruct"]
    assert timed == [("rt3d", 1), ("pooled", 1)]
    assert notes[0] == "rt3d is not run on more than 1 photons per pixel: it would take longer than 0 s"
    assert f"{notes[0]}." in figure1.table(lines) and bar.n + 9 == figure1.steps(tiny)


def timed(method, ppp, median, **more):
    ms = {"min": median, "median": median, "max": median}
    return {"what": "reconstruct", "method": method, "ppp": ppp, "device": "cpu", "ms": ms, "rows": 141, "cols": 141,
            "num_bins": 4613, "sbr": 1.0, "machine": "a chip", "cpus": 2, "date": "2026-01-02", **more}


def test_what_follows_from_figure_1_is_said():
    lines = [timed("rt3d", 1000, 4400.0, input_bytes=119_000_000), timed("pooled", 1000, 40.0, growth_bytes=5_000_000),
             timed("xcorr", 1000, 800.0),
             {"what": "flatness", "ppps": [1, 10, 1000], "max_over_min": 1.07,
              "max_over_min_of_fastest": 1.02}]
    text = figure1.table(lines)
    assert "rt3d takes 110.0 times as long as pooled" in text and "xcorr takes 20.0 times" in text
    assert "from 1 to 1000 photons per pixel, in turns: slowest median / fastest = 1.07 (of the fastest" in text
    assert cells_of(text)[0][3:8] == ["4400", "4400", "4400", "110.0", "119"]
    assert "times as long" not in figure1.table(lines[:1])


def test_figure_1_is_drawn_from_whatever_was_measured(tmp_path):
    from PIL import Image
    figure1.draw(tmp_path / "a.png", [timed("pooled", 1, 40.0, growth_bytes=7, input_bytes=9)])
    assert Image.open(tmp_path / "a.png").width > 1000


def test_sketching_has_every_form_and_density(tiny, bar, notes):
    lines = lines_of(sketching, tiny, bar, notes)
    assert {(line["form"], line["ppp"]) for line in lines} == {
        (form, ppp) for form in sketching.FORMS for ppp in (5, 20)}
    assert bar.n == sketching.steps(tiny) and not notes
    for line in lines:
        assert line["photons_per_s"] == pytest.approx(line["photons"] / line["ms"]["median"] * 1e3, rel=0.01)
        readouts_per_s = 40 / line["ms"]["median"] * 1e3 if line["form"] == "gates" else None
        assert line.get("readouts_per_s") == (readouts_per_s and pytest.approx(readouts_per_s, rel=0.01))


def test_the_sketching_table_has_the_multiple_of_the_arrays_rate():
    line = {"form": "gates", "ppp": 10, "device": "cpu", "frame_from": "host", "photons_per_s": 1e9,
            "ms": {"min": 1.0, "median": 2.0, "max": 3.0}, "readouts_per_s": 451_200.0}
    events = {key: value for key, value in line.items() if key != "readouts_per_s"} | {"form": "sorted"}
    first, second = cells_of(sketching.table([line, events]))
    assert first[0] == "sorted" and second[-1] == "3.0"
