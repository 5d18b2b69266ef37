"""Settings of Sphinx for the documentation site, which `benchmarks.site.build` makes."""

from importlib.metadata import version as installed_version
from typing import Any

from benchmarks.site.docstrings import prepare, skips

project = "solidtouch"
author = "The solidtouch developers"
version = release = installed_version("solidtouch")
root_doc = "index"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
html_theme = "pydata_sphinx_theme"
html_title = "solidtouch"
html_static_path = ["style"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_theme_options = {
    "logo": {"text": "solidtouch"},
    "show_nav_level": 1,
    "navigation_with_keys": False,
    "header_links_before_dropdown": 8,
    "secondary_sidebar_items": {"gallery": [], "**": ["page-toc"]},
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_sidebars = {"gallery": [], "index": []}
copyright = f"{author}, Apache-2.0"  # noqa: A001 - the name that Sphinx reads

smartquotes = False  # they make one dash of the two before an option
highlight_language = "none"

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 6
nb_custom_formats = {".py": "benchmarks.site.notebook.read"}
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True

autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_ivar = True
add_module_names = False

nitpicky = True
# Nothing is read from the network, so types of other packages and of private modules have no page to link to.
nitpick_ignore_regex = [("py:.*", r"(?!solidtouch\.[A-Za-z]+$).*")]
# Examples of the terminal, of JSON with dots in it and the like are no whole programs.
suppress_warnings = ["misc.highlighting_failure"]


def setup(app: Any) -> None:
    """Makes docstrings, which are written as Markdown is, readable for autodoc."""
    app.connect("autodoc-process-docstring", prepare, priority=400)  # before napoleon reads sections
    app.connect("autodoc-skip-member", skips)
