"""Settings of Sphinx for the site; `docs/site/build.py` builds it."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "site"))

project = "lajolla"
author = "The lajolla authors"
release = version = version_of("lajolla")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "book"]
exclude_patterns = ["site"]

myst_enable_extensions = ["attrs_block", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_dmath_double_inline = True

nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # types of other libraries, and private ones, in signatures
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # those of NumPy fill lines; the texts state shapes and ranges
default_role = "code"  # what backticks in docstrings mean
smartquotes = False  # they make dashes of the -- of options
suppress_warnings = ["misc.highlighting_failure"]  # Pygments does not know numbers such as 0x1p-24f
html_theme = "furo"
html_title = "lajolla"
html_math_renderer = "katex"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
html_show_sphinx = False
html_show_search_summary = False  # browsers do not let pages in files read others
html_theme_options = {"navigation_with_keys": True}
