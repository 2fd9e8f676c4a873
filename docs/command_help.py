"""The Sphinx directive ``command-help``: what ``python -m swsysid --help`` prints, as a block.

The text is argparse's own, made while the pages are built, so that the reference cannot drift.
"""

import os
from unittest import mock

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

WIDTH = 84  # characters of a line


def help_text():
    """The help, wrapped for the page and not for the terminal in which it is built."""
    from swsysid._cli.arguments import parser

    with mock.patch.dict(os.environ, COLUMNS=str(WIDTH)):
        return parser().format_help()


class CommandHelp(SphinxDirective):
    """A literal block with the help of the command line."""

    def run(self):
        """One node; no arguments, no content."""
        text = help_text()
        return [nodes.literal_block(text, text, language="text")]


def setup(app):
    """Register the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True}
