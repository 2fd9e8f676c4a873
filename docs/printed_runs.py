"""Run the commands of `from_csv.md`; ``--write`` puts what they print into the page.

A command stands behind ``<!-- printed: NAME -->``, what it prints in the block after it. Lines that
the command before it printed as well are three dots. ``--write`` also renews the page's picture.

As a Sphinx extension it runs them while the pages are built, keeps the pages that they write in
the site, and ends the build where the page shows something else than what was printed.
"""

import os
import re
import shlex
import subprocess
import sys
import tempfile
from itertools import takewhile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "from_csv.md"
REPORTS = {"cart_report.html": "swsysid_diagnosis.html", "cart_recordings.html": "report.html"}
TOLERANCE = 0.05  # relative; digits differ between versions of the solvers
PICTURE = ROOT / "docs" / "_static" / "cart_modes.png"
RUN = re.compile(r"(?<=<!-- printed: )(\w+) -->\n\n```bash\n(.*?)```\n\n```text\n(.*?)```", re.S)
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def printed(command, folder):
    """Standard output of a command of the page, run in a folder beside the examples."""
    if not (folder / "examples").exists():
        (folder / "examples").symlink_to(ROOT / "examples")
    python, *words = shlex.split(command.replace("\\\n", " "))
    environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [{"python": sys.executable}[python], *words],
        cwd=folder,
        env=environment,
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    return done.stdout.replace(str(folder.resolve()), "...")


def news(text, before):
    """The lines of a text, those at its head that stood in the text before left out."""
    lines, known = text.splitlines(), before.splitlines()
    same = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(lines, known)))  # noqa: B905
    return "\n".join(["..."] * bool(same) + lines[same:]) + "\n"


def outputs(page, folder):
    """What each command of a page prints now, by name."""
    shown, before = {}, ""
    for name, command, _ in RUN.findall(page):
        text = printed(command, folder)
        shown[name], before = news(text, before), text
    return shown


def alike(expected, printed, tolerance):
    """Whether two texts have the same words, and numbers that agree within a relative tolerance."""
    if NUMBER.sub("#", expected) != NUMBER.sub("#", printed):
        return False
    pairs = zip(NUMBER.findall(expected), NUMBER.findall(printed), strict=True)
    return all(
        abs(float(one) - float(other)) <= tolerance * max(1.0, abs(float(one)))
        for one, other in pairs
    )


def rewrite(page, shown):
    """The page with other outputs in it."""

    def block(match):
        return match[0].replace(f"```text\n{match[3]}```", f"```text\n{shown[match[1]]}```")

    return RUN.sub(block, page)


def differences(page, shown):
    """The commands of a page that print something else than it shows."""
    return [n for n, _, text in RUN.findall(page) if not alike(text, shown[n], TOLERANCE)]


def keep_report(app):
    """Run the commands of the page and put the pages that they write into the site."""
    if str(app.config.sphinx_gallery_conf.get("plot_gallery", True)) not in ("1", "True"):
        return  # a build that runs nothing
    shown = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as name:
        other = differences(shown, outputs(shown, Path(name)))
        if other:
            raise RuntimeError(f"{other} print other texts: run docs/printed_runs.py --write.")
        for page, written in REPORTS.items():
            Path(app.outdir, page).write_bytes(Path(name, "swsysid_output", written).read_bytes())


def setup(app):
    """Run the commands before the pages are read."""
    app.connect("builder-inited", keep_report)
    return {"parallel_read_safe": True}


def main():
    """Print all outputs, or write them."""
    page = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shown = outputs(page, folder)
        if "--write" in sys.argv:
            PAGE.write_text(rewrite(page, shown), encoding="utf-8")
            PICTURE.write_bytes((folder / "swsysid_output" / "phase_portrait.png").read_bytes())
    print("\n".join(shown.values()))


if __name__ == "__main__":
    main()
