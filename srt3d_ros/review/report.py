"""Write a recording's figures, pictures and plots as one HTML file."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from srt3d_ros import __version__
from srt3d_ros.files.new_files import atomic_write, file_errors
from srt3d_ros.pictures.units import number_text
from srt3d_ros.review.gallery import make_gallery
from srt3d_ros.review.plots import draw_plots
from srt3d_ros.review.recorded import Recorded
from srt3d_ros.review.summary import rows


def write_report(recorded: Recorded, summary: dict, path: Path) -> None:
    """Write the report of a recording and its `summarise` figures as an .html file, or raise InvalidInput."""
    html = _page(recorded, summary)
    with file_errors("report", path), atomic_write(path) as part:
        part.write_text(html, encoding="utf-8")


def _page(recorded: Recorded, summary: dict) -> str:
    templates = FileSystemLoader(Path(__file__).parent)
    environment = Environment(loader=templates, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.get_template("report.html").render(
        version=__version__, title=f"{recorded.path.name}: recording", name=recorded.path.name,
        gallery=make_gallery(recorded),
        plots=[(title, Markup(svg)) for title, svg in draw_plots(recorded)], rows=rows(summary),
        tables=_tables(summary))


def _tables(summary: dict) -> list[tuple[str, list[tuple[str, str]]]]:
    """The recording's properties as (title, rows)."""
    tables = {name.capitalize(): dict(summary.get(name, {})) for name in ("sensor", "run", "versions")}
    return [(title, [(key, _text(value)) for key, value in sorted(facts.items())])
            for title, facts in tables.items() if facts]


def _text(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return number_text(value, 6) if isinstance(value, int | float) and not isinstance(value, bool) else str(value)
