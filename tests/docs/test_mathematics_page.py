"""The page on mathematics: it renders as it is meant, and its numbers are those of the code."""

import pkgutil
import re
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGES = ["mathematics.md", "paper_recipe.md", "paper_reproduced.md"]
# Characters of a line of a display. Of 67 characters it is 657 px wide, measured in a browser, and
# an article between its sidebars has 700 px on a small screen.
WIDEST = 70

# A line of a paragraph that Markdown takes for the start of a quotation, a list or a heading.
ACCIDENT = re.compile(r"^ {0,3}(>|[-+*] |#|\d+[.)] |={3,}$|-{3,}$)")


def source(page):
    """The page without its code blocks."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return re.sub(r"^```.*?^```$", "", text, flags=re.M | re.S)


@pytest.mark.parametrize("page", PAGES)
def test_no_line_of_a_paragraph_starts_a_block_by_accident(page):
    previous = ""
    for line in source(page).splitlines():
        continues = previous.strip() and not previous.startswith(("- ", "  ", "|", "#"))
        starts_list = re.match(r"^(- |\d\. )", line) and re.match(r"^(- |\d\. |  )", previous)
        if continues and not starts_list:
            assert not ACCIDENT.match(line), f"{page}: {line}"
        assert not line.lstrip().startswith(">"), f"{page}: {line}"
        previous = line


def displays(text):
    """Displays, by their TeX."""
    plain = re.findall(r"\$\$(.*?)\$\$", text, re.S)
    return plain + re.findall(r"\\begin\{(?:align|gather)\*\}(.*?)\\end\{", text, re.S)


def width(line):
    """Characters that a line of TeX becomes, about: a fraction is as wide as its wider part."""
    line = re.sub(r"\\(text|operatorname|mathcal|mathbf|mathsf|mathbb)\b", "", line)
    line = re.sub(r"\\tag\{(\w+)\}", r"    \1", line)
    for _ in range(3):
        line = re.sub(r"\\frac\{([^{}]*)\}\{([^{}]*)\}", lambda m: max(m.groups(), key=len), line)
    line = re.sub(r"\\[A-Za-z]+|\\.", "x", line)
    return len(re.sub(r"[{}^_&\s]", "", line))


@pytest.mark.parametrize("page", PAGES)
def test_no_display_is_wider_than_the_page(page):
    for display in displays(source(page)):
        joined = re.sub(r"\n(?!\n)", " ", display)
        for line in re.split(r"\\\\(?![A-Za-z])", joined):
            assert width(line) <= WIDEST, f"{page}: {width(line)} characters: {line}"


def test_a_wide_display_is_noticed():
    wide = (
        r"L(1)=1,\qquad M_r(y)\succeq0,\qquad L\big((\lambda_j^2-\lambda_j)\,p\big)=0,\quad "
        r"L\big((\mathbf 1^{\mathsf T}\lambda-1)\,p\big)=0,\qquad M_{r-1}\big((\delta_k\mp c_k)\,"
        r"y\big)\succeq0"
    )
    assert width(wide) > WIDEST


def test_a_numbered_display_of_several_lines_is_no_error():
    # Sphinx puts split around a display with line breaks, and a tag within split is an error
    for plain in re.findall(r"\$\$(.*?)\$\$", source("mathematics.md"), re.S):
        assert not ("\\tag" in plain and "\\\\" in plain), plain


def test_the_numbers_of_the_search_are_those_of_the_code():
    rows = re.findall(r"^\| ([\d.]+) \| [^|]+ \| `([\w.]+)` \|$", source("mathematics.md"), re.M)
    assert len(rows) >= 12
    for number, name in rows:
        assert float(number) == float(pkgutil.resolve_name(f"swsysid.{name}")), name


def test_every_letter_of_the_table_is_named_once():
    table = source("mathematics.md").split("## Letters and names")[1].split("## ")[0]
    letters = [
        letter.split("=")[0].split("\\in")[0].split("\\ge")[0].strip()
        for row in re.findall(r"^\| (\$[^|]+?) \|", table, re.M)
        for formula in re.findall(r"\$([^$]+)\$", row.split(" (")[0])
        for letter in re.split(r",\s?\\ |,\\ ", formula)
    ]
    assert len(letters) > 50
    assert len(letters) == len(set(letters)), sorted(letters)


SETTINGS = """
extensions = ["myst_parser", "sphinx.ext.mathjax"]
myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence"]
root_doc, html_theme = "mathematics", "basic"
exclude_patterns = ["paper_tables.md", "seeding_table.md"]
# pages that are not here, and their pictures
suppress_warnings = ["myst.xref_missing", "toc.not_included", "image.not_readable"]
"""


def test_pages_render_without_quotations_and_errors(tmp_path):
    pytest.importorskip("myst_parser")
    (tmp_path / "conf.py").write_text(SETTINGS, encoding="utf-8")
    for page in [*PAGES, "paper_tables.md", "seeding_table.md"]:
        (tmp_path / page).write_bytes((DOCS / page).read_bytes())
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", str(tmp_path)]
    done = subprocess.run([*command, str(tmp_path / "html")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for page in PAGES:
        html = (tmp_path / "html" / page).with_suffix(".html").read_text(encoding="utf-8")
        assert "<blockquote" not in html, page
        assert "system-message" not in html, page
        # TeX outside of formulas is a formula that was not recognised
        formulas = r'<(div|span|pre|code)[^>]*class="[^"]*(math|pre|highlight)[^"]*".*?</\1>'
        prose = re.sub(r"<[^>]+>", "", re.sub(formulas, "", html, flags=re.S))
        assert not re.search(r"\\(mathcal|lambda|dot|langle|begin)\b", unescape(prose)), page
