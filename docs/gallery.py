"""Which examples this build can run, and what the pages of the others show instead.

An example that needs measured data calls a ``fetch_*`` function. Where its files can be had the
example runs; where they cannot, its page says so and shows the output that was recorded with the
data (``examples/recorded``, which the tests compare with a fresh run).
"""

import re
from pathlib import Path

from swsysid import datasets

EXAMPLES = Path(__file__).parents[1] / "examples"
FETCH = re.compile(r"\bfetch_\w+")

_NOTE = """
.. admonition:: Not run in this build

   {reason}

   The pictures are therefore missing. With the data, the example prints:

   .. code-block:: none

{printed}

"""
# sphinx-gallery writes this above every block of code, the first one below the page's introduction
_BLOCK = ".. GENERATED FROM PYTHON SOURCE LINES"


def omitted_examples() -> dict[str, str]:
    """Names of the examples whose data cannot be had, each with the reason."""
    reasons = {}
    for example in sorted(EXAMPLES.glob("plot_*.py")):
        for name in sorted(set(FETCH.findall(example.read_text(encoding="utf-8")))):
            try:
                getattr(datasets, name)()
            except OSError as error:
                reasons[example.stem] = str(error)
    return reasons


def filename_pattern(omitted) -> str:
    """sphinx-gallery's pattern of the examples that are run."""
    names = "|".join(re.escape(name) for name in omitted)
    return rf"/(?!(?:{names})\.py)plot_" if names else "/plot_"


def note(name: str, reason: str) -> str:
    """What the page of an omitted example says."""
    recorded = (EXAMPLES / "recorded" / f"{name}.txt").read_text(encoding="utf-8")
    printed = "\n".join(f"      {line}" if line else "" for line in recorded.splitlines())
    return _NOTE.format(reason=reason, printed=printed)


def setup(app):
    """Leave out the examples without data, and put a note above their code."""
    app.setup_extension("sphinx_gallery.gen_gallery")
    omitted = omitted_examples()
    app.config.sphinx_gallery_conf["filename_pattern"] = filename_pattern(omitted)

    def add(_app, document, source):
        name = document.removeprefix("auto_examples/")
        if name in omitted:
            introduction, block, code = source[0].partition(_BLOCK)
            source[0] = introduction + note(name, omitted[name]) + block + code

    app.connect("source-read", add)
    return {"parallel_read_safe": True}
