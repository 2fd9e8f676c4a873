"""Sphinx configuration: Markdown pages, the API from docstrings, the examples run and shown."""

import os
import sys
from importlib.resources import files
from pathlib import Path

import swsysid

sys.path.insert(0, str(Path(__file__).parent))

os.environ.setdefault("MPLBACKEND", "Agg")

project = "swsysid"
author = "the swsysid developers"
copyright = "the swsysid developers"
release = swsysid.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
    "sphinx_design",
    "sphinx_llms_txt",
    # files beside this one
    "gallery",
    "reference",
    "command_help",
    "printed_runs",
    "in_browser_site",
]
# a part of a page that its benchmark writes is no page
exclude_patterns = [
    "_build",
    "auto_examples/*.ipynb",
    "auto_examples/*.py.md5",
    # seconds of the examples, in a table that the network draws
    "auto_examples/sg_execution_times.rst",
    "sg_execution_times.rst",
    "automata_tables.md",
    "others_table.md",
    "calibration_table.md",
    "faults_table.md",
    "mutations_table_0.md",
    "mutations_table_1.md",
    "mutations_table_3.md",
    "fresh_table.md",
    "laboratory_table.md",
    "sensitivity_table.md",
    "unlisted_table.md",
    "measured_by_default.md",
    "measured_effects.md",
    "measured_tables.md",
    "quality_summary.md",
    "recordings_table.md",
    "undeclared_tables.md",
    "peers_table.md",
    "speed_tables.md",
    "paper_tables.md",
    "seeding_table.md",
    "trajectories_tables.md",
]
html_theme = "pydata_sphinx_theme"
# formulas are set without network: all of MathJax, its fonts as outlines, is this one file
mathjax = files("sphinx-mathjax-offline") / "static" / "mathjax" / "tex-svg-full.js"
mathjax_path = mathjax.name
html_static_path = ["_static", str(mathjax)]
html_title = f"swsysid {release}"
html_css_files = ["site.css"]
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "logo": {"text": f"swsysid {release}"},
    "header_links_before_dropdown": 6,
    "footer_start": ["copyright"],
    "footer_end": ["theme-version"],
}

# Markdown twins of the pages are their sources, which `llms.txt` lists for programs that read
html_copy_source = True
llms_txt_title = "swsysid"
llms_txt_summary = (
    "Identifies switching dynamical systems from measured data: the law of each mode, the mode of "
    "each sample, the instants of the switches, and the surface, guards and resets between modes; "
    "finds the effects that a declared model lacks."
)
llms_txt_full_max_size = None

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence"]
myst_heading_anchors = 3

templates_path = ["_templates"]
autosummary_generate = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
# `names` in docstrings are objects: those of the package and of its neighbours become links
default_role = "py:obj"
napoleon_google_docstring = False
napoleon_use_rtype = False


def _inventory(name):
    """The neighbour's own inventory; without network the few names that we use, kept here."""
    return (None, f"inventories/{name}.inv")


intersphinx_mapping = {
    "numpy": ("https://numpy.org/doc/stable/", _inventory("numpy")),
    "scipy": ("https://docs.scipy.org/doc/scipy/", _inventory("scipy")),
    "sklearn": ("https://scikit-learn.org/stable/", _inventory("sklearn")),
}
intersphinx_timeout = 10

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "auto_examples",
    "abort_on_example_error": True,
    "show_memory": False,
    "remove_config_comments": True,
    # what a block prints is shown, not what its last line happens to be
    "capture_repr": (),
    "download_all_examples": False,
    "within_subsection_order": "FileNameSortKey",
    # seconds differ from run to run; so do the warnings of their pickled configuration
    "min_reported_time": 1e9,
}
# sphinx-gallery's configuration cannot be pickled; that is no defect of these pages.
# Methods inherited from scikit-learn refer to labels and terms of its own manual.
suppress_warnings = ["config.cache", "ref.ref", "ref.term"]
