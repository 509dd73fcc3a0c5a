"""Sphinx: `make docs` builds docs/ into out/docs, warnings as errors, for reading offline."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import stickslip

project = "stickslip"
author = "The stickslip developers"
version = release = stickslip.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
extensions += ["device_pages", "offline_math", "reference_pages", "sitemap"]
exclude_patterns = ["_ext", "_static"]
source_suffix = {".rst": "restructuredtext", ".md": "myst-nb"}
suppress_warnings = ["myst.header"]  # a page may begin with a table's heading

html_theme = "furo"
html_title = f"stickslip {release}"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_show_copyright = False
html_math_renderer = "svg"  # MathJax would come from the network
templates_path: list[str] = []

default_role = "code"  # docstrings mark names with one backtick
autodoc_typehints = "none"  # the docstrings say units, which is more
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

nb_execution_mode = "force"
nb_execution_in_temp = True  # what a page writes does not stay
nb_execution_raise_on_error = True
nb_execution_timeout = 240
nb_merge_streams = True
myst_enable_extensions = ["attrs_block", "dollarmath"]
myst_heading_anchors = 3
