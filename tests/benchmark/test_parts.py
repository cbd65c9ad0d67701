"""Each part measures all that it promises, on tiny frames, and says what it leaves out."""

import dataclasses

import pytest

from srt3d_ros.benchmark import figure1, frames, placement, sketching, table1

BUILT = placement.built


def lines_of(part, plan, bar, notes):
    return list(part.measure(plan, bar, notes.append))


def without(monkeypatch, *absent):
    """As where these methods need a package that is not installed."""
    def built(method, *args):
        if method.name in absent:
            raise ModuleNotFoundError("No module named 'numba'", name="numba")
        return BUILT(method, *args)

    monkeypatch.setattr(placement, "built", built)


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
    text = table1.table([line | {"paper_ms": table1.PAPER_MS[705, 10]}, small]).splitlines()
    assert [cell.strip() for cell in text[3].strip("|").split("|")] == [
        "705²", "10", "pooled", "cpu", "host", "500", "512", "600", "88", "1.95", "200", "1234"]
    assert text[2].startswith("| 12² ") and text[2].count("–") == 2


def test_figure_1_has_every_method_at_every_number_of_photons(tiny, bar, notes):
    lines = lines_of(figure1, tiny, bar, notes)
    methods = {*figure1.METHOD_NAMES, "sketching"}
    assert {(line["method"], line["ppp"]) for line in lines[:-1]} == {(m, ppp) for m in methods for ppp in (1, 10)}
    assert all(line["repeats"] == 2 for line in lines[:-1]) and not notes
    assert lines[-1]["what"] == "flatness" and lines[-1]["ppps"] == [1, 10] and lines[-1]["max_over_min"] >= 1
    assert bar.n == figure1.steps(tiny)
    held = {(line["method"], line["ppp"]): line.get("input_bytes") for line in lines[:-1]}
    photons = next(line["photons"] for line in lines[:-1] if line["ppp"] == 10)
    assert held["rt3d", 10] == photons * (4 + 2)                                # pixel and time of arrival
    assert held["xcorr", 1] == held["xcorr", 10] == 2 * 12 * 12 * 4613
    assert held["pooled", 1] == held["pooled", 10] == 12 * 12 * (10 * 8 + 4)


def test_a_method_that_is_too_slow_is_not_run_on_more_photons(tiny, bar, notes, monkeypatch):
    monkeypatch.setattr(figure1, "METHOD_NAMES", ("rt3d", "pooled"))
    lines = lines_of(figure1, dataclasses.replace(tiny, limit_s=0.0), bar, notes)
    timed = [(line["method"], line["ppp"]) for line in lines if line["what"] == "reconstruct"]
    assert timed == [("rt3d", 1), ("pooled", 1)]
    assert "rt3d is not run on more than 1 photons per pixel: it would take longer than 0 s" in notes
    assert f"{notes[0]}." in figure1.table(lines)


def test_what_is_not_installed_is_left_out_and_said(tiny, bar, notes, monkeypatch):
    without(monkeypatch, "rt3d", "srt3d")
    assert {line["method"] for line in lines_of(table1, tiny, bar, notes)} == {"pooled"}
    assert notes[0] == "srt3d is left out: numba is not installed"
    notes.clear()
    lines = lines_of(figure1, dataclasses.replace(tiny, ppps=(3,)), bar, notes)
    assert {line["method"] for line in lines} == {"xcorr", "smle", "pooled", "sketching"}
    assert notes == ["rt3d is left out: numba is not installed", "srt3d is left out: numba is not installed"]


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
    assert "| 4400 " in text and "| 110.0 " in text and "| 119 " in text
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
        assert ("readouts_per_s" in line) == (line["form"] == "gates")
    gates = [line for line in lines if line["form"] == "gates"]
    assert all(line["readouts_per_s"] == pytest.approx(40 / line["ms"]["median"] * 1e3, rel=0.01) for line in gates)


def test_every_run_sees_photons_of_which_nothing_is_known():
    events = frames.photons_of(frames.sensor_of(12), 3)
    assert events.is_sorted and "is_sorted" in vars(events)
    again = sketching.anew(events)
    assert again.pixel is events.pixel and "is_sorted" not in vars(again)


def test_sketching_tells_the_multiple_of_the_arrays_rate():
    line = {"form": "gates", "ppp": 10, "device": "cpu", "frame_from": "host", "photons_per_s": 1e9,
            "ms": {"min": 1.0, "median": 2.0, "max": 3.0}, "readouts_per_s": 451_200.0}
    events = {key: value for key, value in line.items() if key != "readouts_per_s"} | {"form": "sorted"}
    text = sketching.table([line, events]).splitlines()
    assert text[2].startswith("| sorted") and text[3].split("|")[-2].strip() == "3.0"
