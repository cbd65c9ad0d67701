"""Each part measures all that it promises, on tiny frames, and its table says what follows."""

import dataclasses

import pytest

from srt3d_ros.benchmark import figure1, sketching, table1

MS = {"min": 500.0, "median": 512.3, "max": 600.0}


def cells_of(text: str) -> list[list[str]]:
    """The cells of a table's rows, without its heading."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]]


def test_table_1_has_every_size_and_sketch_size(tiny, bar):
    lines = list(table1.measure(tiny, bar))
    assert {(line["method"], line["rows"], line["sketch_size"]) for line in lines} == {
        (method, side, m) for method in ("pooled", "srt3d") for side in (12, 16) for m in (5, 10)}
    assert not bar.notes and bar.shown[-1].startswith("16², m = 10: srt3d")
    for line in lines:
        assert line["repeats"] == 2 and line["device"] == "cpu" and line["frame_from"] == "host"
        assert line["frames_per_s"] == pytest.approx(1e3 / line["ms"]["median"], rel=0.01, abs=0.06)
        assert line["growth_bytes"] < line["process_peak_bytes"]


def test_table_1_stands_beside_the_papers_times():
    line = {"rows": 705, "sketch_size": 10, "method": "pooled", "device": "cpu", "frame_from": "host", "ms": MS,
            "frames_per_s": 1.95, "growth_bytes": 200_000_000, "process_peak_bytes": 1_234_000_000}
    small = line | {"rows": 12, "sketch_size": 5, "paper_ms": None, "growth_bytes": None}
    first, second = cells_of(table1.table([line | {"paper_ms": table1.PAPER_MS[705, 10]}, small]))
    assert second == ["705²", "10", "pooled", "cpu", "host", "500", "512", "600", "88", "1.95", "200", "1234"]
    assert first[0] == "12²" and first.count("–") == 2


def test_figure_1_has_every_method_at_every_number_of_photons(tiny, bar):
    *lines, flatness = figure1.measure(tiny, bar)
    methods = {*figure1.METHOD_NAMES, "sketching"}
    assert {(line["method"], line["ppp"]) for line in lines} == {(m, ppp) for m in methods for ppp in (1, 10)}
    assert all(line["repeats"] == 2 for line in lines) and not bar.notes
    assert flatness["what"] == "flatness" and flatness["ppps"] == [1, 10] and flatness["max_over_min"] >= 1
    held = {(line["method"], line["ppp"]): line.get("input_bytes") for line in lines}
    photons = next(line["photons"] for line in lines if line["ppp"] == 10)
    assert held["rt3d", 10] == photons * (4 + 2)                                # pixel and time of arrival
    assert held["xcorr", 1] == held["xcorr", 10] == 2 * 12 * 12 * 4613
    assert held["pooled", 1] == held["pooled", 10] == 12 * 12 * (10 * 8 + 4)


def test_a_method_that_is_too_slow_is_not_run_on_more_photons(tiny, bar, monkeypatch):
    monkeypatch.setattr(figure1, "METHOD_NAMES", ("rt3d", "pooled"))
    lines = list(figure1.measure(dataclasses.replace(tiny, limit_s=0.0), bar))
    timed = [(line["method"], line["ppp"]) for line in lines if line["what"] == "reconstruct"]
    assert timed == [("rt3d", 1), ("pooled", 1)]
    assert bar.notes[0] == "rt3d is not run on more than 1 photons per pixel: it would take longer than 0 s"
    assert f"{bar.notes[0]}." in figure1.table(lines)


def test_what_follows_from_figure_1_is_said():
    def timed(method, median, **more):
        return {"what": "reconstruct", "method": method, "ppp": 1000, "device": "cpu", **more,
                "ms": dict.fromkeys(("min", "median", "max"), median)}

    lines = [timed("rt3d", 4400.0, input_bytes=119_000_000), timed("pooled", 40.0), timed("xcorr", 800.0),
             {"what": "flatness", "ppps": [1, 10, 1000], "max_over_min": 1.07, "max_over_min_of_fastest": 1.02}]
    text = figure1.table(lines)
    assert "rt3d takes 110.0 times as long as pooled" in text and "xcorr takes 20.0 times" in text
    assert "from 1 to 1000 photons per pixel, in turns: slowest median / fastest = 1.07 (of the fastest" in text
    assert cells_of(text)[0][3:8] == ["4400", "4400", "4400", "110.0", "119"]
    assert "times as long" not in figure1.table(lines[:1])


def test_sketching_has_every_form_and_density_and_the_multiple_of_the_arrays_rate(tiny, bar):
    lines = list(sketching.measure(tiny, bar))
    assert {(line["form"], line["ppp"]) for line in lines} == {
        (form, ppp) for form in sketching.FORMS for ppp in (5, 20)}
    for line in lines:
        assert line["photons_per_s"] == pytest.approx(line["photons"] / line["ms"]["median"] * 1e3, rel=0.01)
        readouts_per_s = 40 / line["ms"]["median"] * 1e3 if line["form"] == "gates" else None
        assert line.get("readouts_per_s") == (readouts_per_s and pytest.approx(readouts_per_s, rel=0.01))
    gates = next(line for line in lines if line["form"] == "gates") | {"readouts_per_s": 451_200.0}
    cells = cells_of(sketching.table([gates, lines[0]]))
    assert cells[0][0] == "sorted" and cells[0][-1] == "–" and cells[1][-1] == "3.0"
