"""The documentation site: Sphinx, Markdown by MyST, docstrings by autodoc.

Sphinx, because docstrings hold its roles, which it links, and because it is maintained. Nothing is fetched, neither at
build time nor by the pages: they open from a folder.

Build: python -m sphinx -W --keep-going -b html docs build/site
"""

import sys
from importlib.metadata import distribution
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

project = "casadi-hbm"
author = "casadi-hbm contributors"
MATHJAX = distribution("sphinx-mathjax-offline").locate_file("sphinx-mathjax-offline/static/mathjax/tex-svg.js")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "generated.pages",
]
exclude_patterns = ["generated"]

html_theme = "furo"
html_title = "casadi-hbm"
html_static_path = ["images/site.css", str(MATHJAX)]
html_css_files = ["site.css"]
mathjax_path = "tex-svg.js"  # this one file of MathJax holds its fonts
html_copy_source = False
html_show_sphinx = False

myst_enable_extensions = ["dollarmath", "attrs_block"]
myst_dmath_double_inline = False
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings have the types, with shapes
autodoc_default_options = {"members": True}
numpydoc_show_class_members = False
suppress_warnings = ["ref.python"]  # names that several classes have, such as H
default_role = "code"
