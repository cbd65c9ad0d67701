"""The tables of the parts, and what they say follows; tests/cli/test_benchmark.py measures every part."""

import dataclasses

from srt3d_ros.benchmark import figure1, sketching, table1

MS = {"min": 500.0, "median": 512.3, "max": 600.0}


def cells_of(text: str) -> list[list[str]]:
    """The cells of a table's rows, without its heading."""
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[2:]]


def test_table_1_stands_beside_the_papers_times():
    line = {"rows": 705, "sketch_size": 10, "method": "pooled", "device": "cpu", "ms": MS,
            "frames_per_s": 1.95, "growth_bytes": 200_000_000, "process_peak_bytes": 1_234_000_000}
    small = line | {"rows": 12, "sketch_size": 5, "paper_ms": None, "growth_bytes": None}
    first, second = cells_of(table1.table([line | {"paper_ms": table1.PAPER_MS[705, 10]}, small]))
    assert second == ["705²", "10", "pooled", "cpu", "500", "512", "600", "88", "1.95", "200", "1234"]
    assert first[0] == "12²" and first.count("–") == 2


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


def test_the_sketching_table_has_the_multiple_of_the_arrays_rate():
    line = {"form": "gates", "ppp": 10, "device": "cpu", "photons_per_s": 1e9, "ms": MS}
    first, second = cells_of(sketching.table([line | {"readouts_per_s": 451_200.0}, line | {"form": "sorted"}]))
    assert (first[0], first[-1]) == ("sorted", "–") and second[-1] == "3.0"
