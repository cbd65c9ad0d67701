"""The documentation site; `make docs` builds it into build/docs."""

import typing

import numpy.typing

from srt3d_ros import __version__

project, version = "srt3d_ros", __version__
html_theme, html_title = "furo", f"srt3d_ros {version}"
html_static_path, html_css_files, html_show_copyright = ["site.css"], ["site.css"], False
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton", "sphinx.ext.mathjax",
              "sphinx-mathjax-offline"]     # which brings MathJax, so that the site needs no network
nitpicky = True                             # a reference to a name that the API page lacks is a warning,
nitpick_ignore_regex = [("py:class", r"(collections|numpy|pathlib)\..*|Axes|.*ArrayLike")]   # but for other packages
numpy.typing.ArrayLike = typing.NewType("ArrayLike", object)    # signatures show the name instead of all that it takes
nb_execution_mode = "off"                   # the notebook is stored with its output, and a test runs it
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
default_role = "code"                       # of docstrings' single backticks
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"          # types in the signature; the text of the arguments says shape and unit
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100  # longer ones get a line for each argument
napoleon_use_ivar = True
# ROS's own tool, rosdoc2, builds this site (rosdoc2.yaml): neither with its theme nor with its parser beside MyST-NB.
rosdoc2_settings = {"override_theme": False, "support_markdown": False}
