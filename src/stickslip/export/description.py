"""Texts of an FMU's XML files: modelDescription.xml for FMI 2.0 and 3.0, buildDescription.xml for 3.0."""

from __future__ import annotations

import math
import sys
from typing import Any
from xml.etree import ElementTree as xml

from .._version import __version__
from .variables import MEASURED, ModelVariable

# Exponents of the SI base units (and rad) in each unit, for modelDescription.xml. Importers need them to
# convert units; of a unit that is not listed they know the name alone.
_BASE = {
    "m": {"m": 1}, "s": {"s": 1}, "kg": {"kg": 1}, "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "N": {"kg": 1, "m": 1, "s": -2}, "m/s": {"m": 1, "s": -1}, "m/s2": {"m": 1, "s": -2},
    "m/V": {"kg": -1, "m": -1, "s": 3, "A": 1}, "rad/s": {"s": -1, "rad": 1}, "rad": {"rad": 1},
    "N/m": {"kg": 1, "s": -2}, "N s/m": {"kg": 1, "s": -1}, "1/s": {"s": -1},
    "rad/s2": {"rad": 1, "s": -2}, "rad/V": {"rad": 1, "kg": -1, "m": -2, "s": 3, "A": 1},
    "N m": {"kg": 1, "m": 2, "s": -2}, "kg m^2": {"kg": 1, "m": 2},
    "N m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1}, "N m s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
}  # fmt: skip


def model_description(
    version: int, identifier: str, token: str, title: str, made: str, found: list[ModelVariable], step: float
) -> str:
    """Return the text of modelDescription.xml, which describes an FMU to importers.

    Args:
        version: version of FMI, 2 or 3.
        identifier: model identifier, which is also the name of the binary.
        token: GUID in braces; the importer passes it to the binary, which so recognises its own description.
        title: description of the model in one line.
        made: date and time of the export, ISO 8601 in UTC.
        found: all variables of the FMU, without the time, which FMI 3.0 needs and which is added here.
        step: suggested communication step (step of the default experiment), s.
    """
    name = {2: "guid", 3: "instantiationToken"}[version]
    root = xml.Element("fmiModelDescription", {
        "fmiVersion": f"{version}.0", "modelName": identifier, name: token, "description": title,
        "version": __version__, "generationTool": f"stickslip {__version__}", "generationDateAndTime": made,
        "variableNamingConvention": "structured", "license": "BSD-3-Clause",
    })  # fmt: skip
    # Only an observer has the measured position. Its gain is valid for the step of its export alone, so
    # importers must not vary the communication step.
    varied = "false" if any(v.name == MEASURED for v in found) else "true"
    can = {"modelIdentifier": identifier, "canHandleVariableCommunicationStepSize": varied}
    if version == 2:
        can |= {
            "canGetAndSetFMUstate": "true",
            "canSerializeFMUstate": "true",
            "canInterpolateInputs": "true",
        }
        source = xml.SubElement(xml.SubElement(root, "CoSimulation", can), "SourceFiles")
        for file in sources(version):
            xml.SubElement(source, "File", {"name": file})
    else:
        can |= {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
        xml.SubElement(root, "CoSimulation", can)
    _units(root, found)
    log = xml.SubElement(root, "LogCategories")
    for category in ("logStatusWarning", "logStatusError"):
        xml.SubElement(log, "Category", {"name": category})
    xml.SubElement(root, "DefaultExperiment", {"startTime": "0", "stopTime": "1.6", "stepSize": repr(step)})
    names = xml.SubElement(root, "ModelVariables")
    if version == 3:
        xml.SubElement(names, "Float64", {
            "name": "time", "valueReference": "0", "causality": "independent", "variability": "continuous",
            "description": "Simulation time", "unit": "s",
        })  # fmt: skip
    for variable in found:
        (_scalar_2 if version == 2 else _variable_3)(names, variable)
    structure = xml.SubElement(root, "ModelStructure")
    outputs = [(i, v) for i, v in enumerate(found) if v.causality == "output"]
    if version == 2:
        for tag in ("Outputs", "InitialUnknowns"):
            group = xml.SubElement(structure, tag)
            for i, _ in outputs:
                xml.SubElement(group, "Unknown", {"index": str(i + 1)})
    else:
        for tag in ("Output", "InitialUnknown"):
            for _, variable in outputs:
                xml.SubElement(structure, tag, {"valueReference": str(variable.reference)})
    xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="unicode") + "\n"


def sources(version: int) -> tuple[str, ...]:
    """Return the names of the C files in sources/ that are compiled for a version of FMI, 2 or 3."""
    return ("stickslip.c", "stickslip_parameters.c", f"fmi{version}.c")


def build_description(identifier: str) -> str:
    """Return the text of sources/buildDescription.xml, by which importers of FMI 3.0 compile the sources."""
    root = xml.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    build = xml.SubElement(root, "BuildConfiguration", {"modelIdentifier": identifier})
    files = xml.SubElement(build, "SourceFileSet", {"language": "C99"})
    for file in sources(3):
        xml.SubElement(files, "SourceFile", {"name": file})
    xml.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + xml.tostring(root, encoding="unicode") + "\n"


def _units(root: xml.Element, found: list[ModelVariable]) -> None:
    units = sorted({v.unit for v in found if v.unit} | {"s"})
    group = xml.SubElement(root, "UnitDefinitions")
    for unit in units:
        one = xml.SubElement(group, "Unit", {"name": unit})
        if unit in _BASE:
            xml.SubElement(one, "BaseUnit", {base: str(power) for base, power in _BASE[unit].items()})


def _number(value: float) -> str:
    """Return a number as text for XML; ±infinity, which FMI does not allow, becomes ± the largest double."""
    return repr(math.copysign(sys.float_info.max, value)) if math.isinf(value) else repr(float(value))


def _attributes(variable: ModelVariable) -> dict[str, str]:
    made = {"name": variable.name, "valueReference": str(variable.reference), "causality": variable.causality,
            "description": variable.description}  # fmt: skip
    if variable.causality == "parameter":
        made |= {"variability": "fixed"}
    elif variable.boolean:
        made |= {"variability": "discrete"}
    else:
        made |= {"variability": "continuous"}
    return made


def _start(variable: ModelVariable) -> dict[str, Any]:
    if variable.causality == "output" or variable.start is None:
        return {}
    if variable.boolean:
        return {"start": "true" if variable.start else "false"}
    return {"start": _number(float(variable.start))}


def _scalar_2(names: xml.Element, variable: ModelVariable) -> None:
    scalar = xml.SubElement(names, "ScalarVariable", _attributes(variable))
    unit = {"unit": variable.unit} if variable.unit and not variable.boolean else {}
    xml.SubElement(scalar, "Boolean" if variable.boolean else "Real", {**unit, **_start(variable)})


def _variable_3(names: xml.Element, variable: ModelVariable) -> None:
    unit = {"unit": variable.unit} if variable.unit and not variable.boolean else {}
    kind = "Boolean" if variable.boolean else "Float64"
    xml.SubElement(names, kind, {**_attributes(variable), **unit, **_start(variable)})
