"""Reports as mappings with types that JSON knows, and as self-contained HTML."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, is_dataclass
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_DPI = 100
_STYLE = """
.swsysid { font: 16px/1.5 system-ui, sans-serif; color: #1b1b1b; background: #fff;
  max-width: 62rem; margin: 0 auto; padding: 1rem 1.5rem 3rem; }
.swsysid h1 { font-size: 1.7rem; line-height: 1.2; margin: .6rem 0; }
.swsysid h2 { font-size: 1.25rem; margin: 2.2rem 0 .4rem; border-bottom: 1px solid #ccc; }
.swsysid h3 { font-size: 1.05rem; margin: 1.4rem 0 .3rem; }
.swsysid .verdict { font-size: 1.15rem; border-left: 4px solid #0072B2; padding: .3rem .8rem; }
.swsysid table { border-collapse: collapse; margin: .6rem 0; font-variant-numeric: tabular-nums; }
.swsysid th, .swsysid td { padding: .25rem .8rem; text-align: right;
  border-bottom: 1px solid #ddd; }
.swsysid th:first-child, .swsysid td:first-child { text-align: left; }
.swsysid thead th { border-bottom: 2px solid #888; }
.swsysid table.ladder tbody tr:last-child { font-weight: 600; }
.swsysid table:not(.words) td:not(:first-child) { white-space: nowrap; }
.swsysid .scroll { overflow-x: auto; }
.swsysid table.words td { text-align: left; }
.swsysid table.words th { text-align: left; }
.swsysid figure { margin: .8rem 0; }
.swsysid figure img { max-width: 100%; height: auto; }
.swsysid figcaption { color: #555; font-size: .9rem; }
.swsysid pre { overflow-x: auto; background: #f5f5f5; padding: .6rem; font-size: .8rem; }
.swsysid .note { color: #555; font-size: .9rem; }
"""


class Parts(Mapping[str, Any]):
    """An object that is also a mapping of some of its attributes, by their names."""

    _parts: ClassVar[tuple[str, ...]] = ()

    def __getitem__(self, name: str) -> Any:
        if name not in self._parts:
            known = ", ".join(self._parts)
            raise KeyError(f"{name!r} is no part of the report; these are: {known}.")
        return getattr(self, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def to_dict(self) -> dict[str, object]:
        """Everything but `data`, in types that JSON knows; NaN becomes None."""
        return entries_of(self)

    def __repr__(self) -> str:
        return str(self)


def entries_of(values: Mapping[str, object]) -> dict[str, object]:
    """A mapping in types that JSON knows; what is not finite becomes None."""
    return {str(name): plain(entry) for name, entry in values.items()}


def plain(value: object) -> object:
    """The same in types that JSON knows; what is not finite becomes None."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Mapping):
        return entries_of(value)
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, (tuple, list)):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def page(title: str, body: Iterable[str], head: str = "") -> str:
    """A whole page; `head` is what else stands in its head, as HTML."""
    inside = "\n".join(body)
    return (
        "<!DOCTYPE html>\n"
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{_STYLE}</style>{head}</head>\n"
        f'<body><main class="swsysid">\n<h1>{escape(title)}</h1>\n{inside}\n'
        "</main></body></html>\n"
    )


def section(title: str, parts: Iterable[str], level: int = 2) -> str:
    """A heading and what stands under it."""
    return "\n".join([f"<h{level}>{escape(title)}</h{level}>", *parts])


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph, of a class of the style sheet."""
    return f"<p{_class(kind)}>{escape(text)}</p>"


def listing(entries: Iterable[str]) -> str:
    """A list with a dot for each entry."""
    return "<ul>" + "".join(f"<li>{escape(entry)}</li>" for entry in entries) + "</ul>"


def code(text: str) -> str:
    """Lines as they are, such as equations."""
    return f"<pre>{escape(text)}</pre>"


def preformatted(summary: str, text: str) -> str:
    """Text in columns, folded away under a summary."""
    return f"<details><summary>{escape(summary)}</summary><pre>{escape(text)}</pre></details>"


def table(head: Sequence[str], rows: Iterable[Sequence[object]], kind: str = "") -> str:
    """A table; numbers get four digits."""
    titles = "".join(f'<th scope="col">{escape(title)}</th>' for title in head)
    cells = ([f"{one:.4g}" if isinstance(one, float) else str(one) for one in row] for row in rows)
    lines = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in cells)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    inside = f"<thead><tr>{titles}</tr></thead><tbody>{body}</tbody>"
    return f'<div class="scroll"><table{_class(kind)}>{inside}</table></div>'


def figure(drawn: Figure, caption: str) -> str:
    """A matplotlib figure as a picture inside the page; the figure is closed."""
    import matplotlib.pyplot as plt

    stream = io.BytesIO()
    # no date and no version: the same report gives the same page
    drawn.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
    plt.close(drawn)
    data = base64.b64encode(stream.getvalue()).decode("ascii")
    escaped = escape(caption)
    return (
        f'<figure><img alt="{escaped}" src="data:image/png;base64,{data}">'
        f"<figcaption>{escaped}</figcaption></figure>"
    )


def _class(kind: str) -> str:
    return f' class="{escape(kind)}"' if kind else ""
