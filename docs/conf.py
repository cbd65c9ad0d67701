"""The documentation site; `make docs` builds it into build/docs."""

from srt3d_ros import __version__

project, version = "srt3d_ros", __version__
html_theme, html_title = "furo", f"srt3d_ros {version}"
html_static_path, html_css_files, html_show_copyright = ["site.css"], ["site.css"], False
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton", "sphinx.ext.mathjax",
              "sphinx-mathjax-offline"]     # which brings MathJax, so that the site needs no network
nb_execution_mode = "off"                   # the notebook is stored with its output, and a test runs it
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
default_role = "code"                       # of docstrings' single backticks
autodoc_member_order = "bysource"
autodoc_typehints = "none"                  # the text of the arguments says shape, type and unit
napoleon_use_ivar = True

# Pages of other folders are pages of the site, too.
PAGES = {"../msg_schemas/README.md": "messages.md", "../benchmarks/RESULTS.md": "results.md"}


def links_within_the_site(app, name: str, source: list[str]) -> None:
    if name not in ("messages", "results"):
        for path, page in PAGES.items():
            source[0] = source[0].replace(f"]({path}", f"]({page}")


def setup(app) -> None:
    app.connect("source-read", links_within_the_site)
