"""What the pages of the reference need besides autodoc: every attribute once, types as links."""

import importlib
import inspect
import re
from enum import EnumType

# "names : type" in a section of a numpydoc docstring
FIELD = re.compile(r"^(?P<names>\**\w+(?:, \**\w+)*) : (?P<type>.*)$")
TYPED = ("Parameters", "Attributes", "Returns")
# words of our docstrings that name something of a neighbour's
LINKS = {
    "ndarray": ":class:`~numpy.ndarray`",
    "array-like": ":data:`array-like <numpy.typing.ArrayLike>`",
    "Bunch": ":class:`~sklearn.utils.Bunch`",
}
# where a class has two public names, the later one here is that of its page
HOMES = (
    "diagnosis differentiation effects exporting metrics plotting refinement uncertainty "
    "weak_form".split()
)
for module in (*(f"swsysid.{home}" for home in HOMES), "swsysid", "swsysid.results"):
    content = importlib.import_module(module)
    for name in content.__all__:
        if inspect.isclass(getattr(content, name)):
            LINKS[name] = f":class:`~{module}.{name}`"


def attributes_told(module: str, name: str) -> list[str]:
    """Attributes that the docstring of a class describes, and autodoc must not list again."""
    value = getattr(importlib.import_module(module), name)
    fields = [member.name for member in value] if _gives_advice(value) else []
    for section, line in _with_sections(inspect.cleandoc(value.__doc__ or "").splitlines()):
        field = FIELD.match(line)
        if section == "Attributes" and field:
            fields += field["names"].split(", ")
    return fields


def setup(app):
    """Rewrite docstrings ahead of napoleon, which runs at priority 500."""
    app.setup_extension("sphinx.ext.autosummary")
    app.connect("autodoc-process-docstring", _silence_builtin, priority=100)
    app.connect("autodoc-process-docstring", _tell_advice, priority=100)
    app.connect("autodoc-process-docstring", _split_and_link, priority=200)
    app.connect(
        "config-inited",
        lambda _app, config: config.autosummary_context.update(attributes_told=attributes_told),
    )
    return {"parallel_read_safe": True}


def _with_sections(lines):
    """Every line, with the name of the numpydoc section that it stands in."""
    section = ""
    for position, line in enumerate(lines):
        below = lines[position + 1] if position + 1 < len(lines) else ""
        if line and len(below) == len(line) and set(below) == {"-"}:
            section = line
        yield section, line


def _split_and_link(_app, kind, _name, _member, _options, lines):
    """``a, b : ndarray`` becomes two entries that links can find, with linked types."""
    rewritten, names, description = [], [], []

    def flush():
        for name in names:
            rewritten.extend([name, *description])

    for section, line in _with_sections(lines):
        field = FIELD.match(line) if section in TYPED else None
        if field and section == "Attributes":
            flush()
            names = [f"{name} : {_linked(field['type'])}" for name in field["names"].split(", ")]
            description = []
        elif names and (not line or line.startswith(" ")):
            description.append(line)
        else:
            flush()
            names, description = [], []
            rewritten.append(_linked_line(section, field, line))
    flush()
    lines[:] = rewritten


def _linked_line(section, field, line):
    if field:
        return f"{field['names']} : {_linked(field['type'])}"
    alone = section == "Returns" and line and not line.startswith((" ", "-")) and line != section
    return _linked(line) if alone else line


def _linked(words: str) -> str:
    """Known names as links; a name that ends in an underscore is no link of its own."""
    words = re.sub(r"(?<=\w)_(?!\w)", r"\\_", words)
    return re.sub(r"[\w-]+", lambda word: LINKS.get(word[0], word[0]), words)


def _silence_builtin(_app, kind, _name, value, _options, lines):
    """A constant of a built-in type has no docstring; the page of public names says what it is."""
    if kind == "data" and inspect.cleandoc(type(value).__doc__ or "") == "\n".join(lines).strip():
        lines.clear()


def _tell_advice(_app, _kind, _name, value, _options, lines):
    """The members of an enumeration that gives advice are told with it."""
    if _gives_advice(value):
        lines += ["Attributes", "----------"]
        for member in value:
            lines += [f"{member.name} : {member.value!r}", f"    {member.advice}"]
        lines.append("")


def _gives_advice(value) -> bool:
    return isinstance(value, EnumType) and "advice" in vars(value)
