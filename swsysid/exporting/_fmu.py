"""A system as a functional mock-up unit: source code for FMI 2 model exchange, no binary."""

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
from swsysid.exporting._fmu_source import INTERFACE
from swsysid.exporting._system import HybridSystem
from swsysid.exporting._text import identifiers

_EPOCH = (1980, 1, 1, 0, 0, 0)  # equal models are equal files


def write_fmu(system: HybridSystem, path: str | Path, name: str) -> None:
    """Write the unit: its description and one C file."""
    if system.discrete_time:
        raise NoFormulaError(
            "model exchange has continuous time and this model is a map; write it with to_c."
        )
    [prefix] = identifiers([name])
    written = with_switches(system)
    first = -1 if system.surfaces is not None else written.labels[written.starts[0][0]]
    source = _source(written, first, prefix, system.notes)
    token = hashlib.sha256(source.encode()).hexdigest()[:32]
    source = source.replace(f"{prefix}_GUID", f'"{token}"')
    with written_beside(path) as draft, zipfile.ZipFile(draft, "w") as unit:
        for place, content in (
            ("modelDescription.xml", _description(written, first, prefix, token)),
            ("sources/model.c", source.encode()),
        ):
            unit.writestr(zipfile.ZipInfo(place, _EPOCH), content)


def _source(written: HybridSystem, first: int, prefix: str, notes: Sequence[str]) -> str:
    n = len(written.states)
    return "\n".join(
        [
            formulas(written, prefix, notes, "static "),
            '\n#include <stdlib.h>\n#include "fmi2Functions.h"\n',
            f"#define {prefix}_ASKED {2 * n + len(written.inputs)}",
            f"static const double {prefix}_size[] = {{{listed(written.sizes)}}};",
            f"static const double {prefix}_origin[] = {{{listed(written.origin)}}};",
            f"static const int {prefix}_first = {first};",
            INTERFACE.replace("NAME", prefix),
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
    names = identifiers([*system.states, *system.inputs], ("mode", "mode_start", "mode_or_slide"))
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
    meaning = "mode to start in; -1 is the one that the state tells"
    one = _variable(told, "mode_start", asked, "parameter", "fixed", meaning, initial="exact")
    SubElement(one, "Integer", start=str(first))
    modes = "; ".join(f"{mode} {title}" for mode, title in enumerate(system.titles))
    SubElement(_variable(told, "mode", asked + 1, "output", "discrete", "mode of the model"),
               "Integer")  # fmt: skip
    SubElement(_variable(told, "mode_or_slide", asked + 2, "output", "discrete", modes), "Integer")
    structure = SubElement(root, "ModelStructure")
    last = 2 * n + m + 1  # indices of variables count from one
    _unknowns(structure, "Outputs", [*range(1, n + 1), last + 1, last + 2])
    _unknowns(structure, "Derivatives", range(n + 1, 2 * n + 1))
    _unknowns(structure, "InitialUnknowns", [*range(n + 1, 2 * n + 1), last + 1, last + 2])
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
