"""A system as a functional mock-up unit: source code for model exchange, FMI 2 or 3, no binary."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import SubElement

from swsysid._whole_or_nothing import written_beside
from swsysid.exporting._c import formulas, listed, with_switches
from swsysid.exporting._expressions import NoFormulaError
from swsysid.exporting._fmu_source import EVENTS, INTERFACES
from swsysid.exporting._system import HybridSystem
from swsysid.exporting._text import identifiers

_EPOCH = (1980, 1, 1, 0, 0, 0)  # equal models are equal files
_OWN = ("mode", "mode_start", "mode_or_slide", "time")
_MODE_START = "mode to start in; -1 is the one that the state tells"


def write_fmu(system: HybridSystem, path: str | Path, name: str, version: int) -> None:
    """Write the unit: its description, that of its build where FMI 3 asks for it, one C file."""
    if version not in INTERFACES:
        raise ValueError(f"fmi_version={version!r} is neither 2 nor 3.")
    if system.discrete_time:
        raise NoFormulaError(
            "model exchange has continuous time and this model is a map; write it with to_c."
        )
    [prefix] = identifiers([name])
    written = with_switches(system)
    first = -1 if system.surfaces is not None else written.labels[written.starts[0][0]]
    source = _source(written, first, prefix, system.notes, version)
    token = hashlib.sha256(source.encode()).hexdigest()[:32]
    source = source.replace(f"{prefix}_GUID", f'"{token}"')
    describe = _description if version == 2 else _description_of_3
    contents = {"modelDescription.xml": describe(written, first, prefix, token)}
    if version == 3:
        contents["sources/buildDescription.xml"] = _build(prefix)
    contents["sources/model.c"] = source.encode()
    with written_beside(path) as draft, zipfile.ZipFile(draft, "w") as unit:
        for place, content in contents.items():
            unit.writestr(zipfile.ZipInfo(place, _EPOCH), content)


def _source(
    written: HybridSystem, first: int, prefix: str, notes: Sequence[str], version: int
) -> str:
    n = len(written.states)
    return "\n".join(
        [
            formulas(written, prefix, notes, "static "),
            f'\n#include <stdlib.h>\n#include "fmi{version}Functions.h"\n',
            f"#define {prefix}_ASKED {2 * n + len(written.inputs)}",
            f"static const double {prefix}_size[] = {{{listed(written.sizes)}}};",
            f"static const double {prefix}_origin[] = {{{listed(written.origin)}}};",
            f"static const int {prefix}_first = {first};",
            (EVENTS + INTERFACES[version]).replace("NAME", prefix),
        ]
    )


def _description(system: HybridSystem, first: int, prefix: str, token: str) -> bytes:
    """The file that says which variables there are.

    References: states, their rates, inputs; the mode to start in, the mode of the model, and the
    mode with slides as modes of their own.
    """
    n, m = len(system.states), len(system.inputs)
    root = ElementTree.Element(
        "fmiModelDescription", fmiVersion="2.0", modelName=prefix, guid=f"{token}",
        generationTool="swsysid", variableNamingConvention="structured",
        numberOfEventIndicators=str(len(system.edges)),
    )  # fmt: skip
    able = dict.fromkeys(
        ("canGetAndSetFMUstate", "canSerializeFMUstate", "completedIntegratorStepNotNeeded"), "true"
    )
    exchange = SubElement(root, "ModelExchange", able, modelIdentifier=prefix)
    SubElement(SubElement(exchange, "SourceFiles"), "File", name="model.c")
    told = SubElement(root, "ModelVariables")
    names = identifiers([*system.states, *system.inputs], _OWN)
    states, inputs = names[:n], names[n:]
    for place, (name, title) in enumerate(zip(states, system.states, strict=True)):
        one = _variable(told, name, place, "output", "continuous", title, initial="exact")
        SubElement(one, "Real", start=repr(system.origin[place]),
                   nominal=repr(system.sizes[place]))  # fmt: skip
    for place, name in enumerate(states):
        one = _variable(told, f"der({name})", n + place, "local", "continuous")
        SubElement(one, "Real", derivative=str(place + 1))
    for place, (name, title) in enumerate(zip(inputs, system.inputs, strict=True)):
        one = _variable(told, name, 2 * n + place, "input", "continuous", title)
        SubElement(one, "Real", start="0.0")
    asked = 2 * n + m
    one = _variable(told, "mode_start", asked, "parameter", "fixed", _MODE_START, initial="exact")
    SubElement(one, "Integer", start=str(first))
    modes = _modes(system)
    SubElement(_variable(told, "mode", asked + 1, "output", "discrete", "mode of the model"),
               "Integer")  # fmt: skip
    SubElement(_variable(told, "mode_or_slide", asked + 2, "output", "discrete", modes), "Integer")
    structure = SubElement(root, "ModelStructure")
    last = 2 * n + m + 1  # indices of variables count from one
    _unknowns(structure, "Outputs", [*range(1, n + 1), last + 1, last + 2])
    _unknowns(structure, "Derivatives", range(n + 1, 2 * n + 1))
    _unknowns(structure, "InitialUnknowns", [*range(n + 1, 2 * n + 1), last + 1, last + 2])
    return _text(root)


def _description_of_3(system: HybridSystem, first: int, prefix: str, token: str) -> bytes:
    """The same for FMI 3, where the time and the indicators are variables, too."""
    n, m = len(system.states), len(system.inputs)
    root = ElementTree.Element(
        "fmiModelDescription", fmiVersion="3.0", modelName=prefix, instantiationToken=token,
        generationTool="swsysid", variableNamingConvention="structured",
    )  # fmt: skip
    SubElement(
        root, "ModelExchange", modelIdentifier=prefix, canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )  # fmt: skip
    told, structure = SubElement(root, "ModelVariables"), SubElement(root, "ModelStructure")
    names = identifiers([*system.states, *system.inputs], _OWN)
    asked = 2 * n + m

    def variable(kind: str, name: str, reference: int, causality: str, **more: str) -> None:
        given = {"name": name, "valueReference": str(reference), "causality": causality}
        SubElement(told, kind, given | {key: one for key, one in more.items() if one})

    moving = {"variability": "continuous"}
    variable("Float64", "time", asked + 3, "independent", **moving)
    for place, (name, title) in enumerate(zip(names[:n], system.states, strict=True)):
        variable("Float64", name, place, "output", **moving, description=title, initial="exact",
                 start=repr(system.origin[place]), nominal=repr(system.sizes[place]))  # fmt: skip
        variable("Float64", f"der({name})", n + place, "local", **moving, derivative=str(place))
    for place, (name, title) in enumerate(zip(names[n:], system.inputs, strict=True)):
        variable("Float64", name, 2 * n + place, "input", **moving, description=title, start="0.0")
    variable("Int32", "mode_start", asked, "parameter", variability="fixed", initial="exact",
             description=_MODE_START, start=str(first))  # fmt: skip
    variable("Int32", "mode", asked + 1, "output", variability="discrete",
             description="mode of the model")  # fmt: skip
    variable("Int32", "mode_or_slide", asked + 2, "output", variability="discrete",
             description=_modes(system))  # fmt: skip
    edges = range(len(system.edges))
    for edge in edges:
        variable("Float64", f"guard_{edge}", asked + 4 + edge, "local", **moving)
    modes, rates = (asked + 1, asked + 2), range(n, 2 * n)
    for kind, references in (
        ("Output", (*range(n), *modes)),
        ("ContinuousStateDerivative", rates),
        ("InitialUnknown", (*rates, *modes)),
        ("EventIndicator", (asked + 4 + edge for edge in edges)),
    ):
        for reference in references:
            SubElement(structure, kind, valueReference=str(reference))
    return _text(root)


def _build(prefix: str) -> bytes:
    """Which files FMI 3 compiles, and in which language."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    one = SubElement(root, "BuildConfiguration", modelIdentifier=prefix)
    SubElement(SubElement(one, "SourceFileSet", language="C99"), "SourceFile", name="model.c")
    return _text(root)


def _modes(system: HybridSystem) -> str:
    return "; ".join(f"{mode} {title}" for mode, title in enumerate(system.titles))


def _text(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _variable(
    told: ElementTree.Element,
    name: str,
    reference: int,
    causality: str,
    variability: str,
    description: str = "",
    **more: str,
) -> ElementTree.Element:
    given = {"name": name, "valueReference": str(reference), "causality": causality}
    given |= {"variability": variability, **more}
    if description:
        given["description"] = description
    return SubElement(told, "ScalarVariable", given)


def _unknowns(structure: ElementTree.Element, kind: str, places: Iterable[int]) -> None:
    listed = SubElement(structure, kind)
    for place in places:
        SubElement(listed, "Unknown", index=str(place))
