"""Sphinx's settings: `python -m sphinx -W --keep-going -j auto docs build/docs` writes the pages."""

import logging
import sys
from importlib import metadata
from pathlib import Path

logging.basicConfig(
    level=logging.WARNING
)  # before a style that furo imports asks for all that libraries say
sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "stiffscope"
release = metadata.version("stiffscope")
project_copyright = "the authors of stiffscope"
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx-mathjax-offline",
    "sphinx_click",
    "sphinx_copybutton",
    "cross_links",
    "file_reference",
    "json_answers",
    "known_answers",
    "measured_machines",
]
myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
myst_links_external_new_tab = False
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
napoleon_google_docstring = False
exclude_patterns = ["extensions"]
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_js_files = ["pages.js"]
man_pages = [
    (
        "reference/commands",
        "stiffscope",
        "stiffness of robots, from CAD to the gap to the machine",
        "",
        1,
    )
]
copybutton_exclude = ".linenos, .gp, .go"
html_title = f"stiffscope {release}"
html_show_sphinx = False
suppress_warnings = ["myst.header"]
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True


def setup(app):
    """Let pages be read in parallel: `sphinx-mathjax-offline` only copies files, but does not declare so."""
    mathjax = app.extensions["sphinx-mathjax-offline"]
    mathjax.parallel_read_safe = mathjax.parallel_write_safe = True
