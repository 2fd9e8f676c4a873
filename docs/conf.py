"""Sphinx configuration: Markdown pages, the API from docstrings, the examples run and shown."""

import os

import swsysid
from swsysid.datasets import fetch_emps

os.environ.setdefault("MPLBACKEND", "Agg")

project = "swsysid"
author = "the swsysid developers"
copyright = "the swsysid developers"
release = swsysid.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
# a part of a page that its benchmark writes is no page
exclude_patterns = [
    "_build",
    "auto_examples/*.ipynb",
    "auto_examples/*.py.md5",
    "measured_effects.md",
    "quality_summary.md",
    "undeclared_tables.md",
    "speed_tables.md",
]
html_theme = "pydata_sphinx_theme"
html_static_path = ["_static"]
html_title = "swsysid"
html_theme_options = {"show_toc_level": 2, "navigation_with_keys": False}

myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3

autosummary_generate = True
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False
# shapes such as (n_modes_, n_states) are words, not links
napoleon_preprocess_types = True


def _has_measurements():
    try:
        return bool(fetch_emps())
    except OSError:
        return False


sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "auto_examples",
    # an example whose data cannot be had is shown without being run
    "filename_pattern": "/plot_" if _has_measurements() else "/plot_(?!emps)",
    "abort_on_example_error": True,
    "show_memory": False,
    "download_all_examples": False,
    "within_subsection_order": "FileNameSortKey",
    # seconds differ from run to run; so do the warnings of their pickled configuration
    "min_reported_time": 1e9,
}
# sphinx-gallery's configuration cannot be pickled; that is no defect of these pages.
# Methods inherited from scikit-learn refer to labels of its own manual.
suppress_warnings = ["config.cache", "ref.ref"]
