# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""modelDescription.xml of FMI 2.0 and 3.0, and the build description of 3.0."""

from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from hmcvt_core.version import __version__

from .fmi_variables import BOOLEAN, INTEGER, REAL, UNITS, Variable

MODEL_NAME = "hydromechanical_cvt"
_FMI2_TYPES = {REAL: "Real", INTEGER: "Integer", BOOLEAN: "Boolean"}
_FMI3_TYPES = {REAL: "Float64", INTEGER: "Int32", BOOLEAN: "Boolean"}
_STOP_TIME = 10.0  # of the default experiment [s]
_STEP = 0.01


class Identity(NamedTuple):
    """What names an FMU.

    Attributes:
        token: the GUID, or instantiation token.
        identifier: the model identifier, which names the binary.
        description: of the model, for its user.
    """

    token: str
    identifier: str
    description: str


def fmi2_description(
    variables: Sequence[Variable], identity: Identity, sources: Sequence[str]
) -> str:
    """Return modelDescription.xml of FMI 2.0.

    Args:
        variables: in the order of their value references.
        identity: token, identifier and description.
        sources: file names in the folder of sources.
    """
    root = _root("2.0", {"guid": identity.token}, identity.description)
    for kind in ("ModelExchange", "CoSimulation"):
        interface = SubElement(root, kind, modelIdentifier=identity.identifier)
        interface.set("canGetAndSetFMUstate", "true")
        interface.set("canSerializeFMUstate", "true")
        if kind == "CoSimulation":
            interface.set("canHandleVariableCommunicationStepSize", "true")
        files = SubElement(interface, "SourceFiles")
        for name in sources:
            SubElement(files, "File", name=name)
    _add_units(root)
    _add_experiment(root)
    listed = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        _add_fmi2_variable(listed, variable, reference)
    structure = SubElement(root, "ModelStructure")
    for group in ("Outputs", "InitialUnknowns"):
        unknowns = SubElement(structure, group)
        for position, variable in enumerate(variables, 1):
            if variable.causality == "output":
                SubElement(unknowns, "Unknown", index=str(position))
    return _text(root)


def fmi3_description(variables: Sequence[Variable], identity: Identity) -> str:
    """Return modelDescription.xml of FMI 3.0; arguments as of `fmi2_description`."""
    token = {"instantiationToken": identity.token}
    root = _root("3.0", token, identity.description)
    for kind in ("ModelExchange", "CoSimulation"):
        interface = SubElement(root, kind, modelIdentifier=identity.identifier)
        interface.set("canGetAndSetFMUState", "true")
        interface.set("canSerializeFMUState", "true")
        if kind == "CoSimulation":
            interface.set("canHandleVariableCommunicationStepSize", "true")
    _add_units(root)
    _add_experiment(root)
    listed = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        _add_fmi3_variable(listed, variable, reference)
    structure = SubElement(root, "ModelStructure")
    for group in ("Output", "InitialUnknown"):
        for reference, variable in enumerate(variables):
            if variable.causality == "output":
                SubElement(structure, group, valueReference=str(reference))
    return _text(root)


def build_description(identifier: str, sources: Sequence[str]) -> str:
    """Return buildDescription.xml of FMI 3.0."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = SubElement(configuration, "SourceFileSet", language="C99")
    for name in sources:
        SubElement(files, "SourceFile", name=name)
    SubElement(
        files,
        "PreprocessorDefinition",
        name="FMI3_OVERRIDE_FUNCTION_PREFIX",
        value="1",
        description="Names of functions without a prefix, as a shared library needs them",
    )
    return _text(root)


def _root(fmi_version: str, token: dict[str, str], description: str) -> Element:
    return Element(
        "fmiModelDescription",
        {
            "fmiVersion": fmi_version,
            "modelName": MODEL_NAME,
            **token,
            "description": description,
            "generationTool": f"hmcvt {__version__}",
            "variableNamingConvention": "flat",
        },
    )


def _add_units(root: Element) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for unit in UNITS:
        entry = SubElement(definitions, "Unit", name=unit.name)
        exponents = {name: str(exponent) for name, exponent in unit.exponents}
        SubElement(entry, "BaseUnit", exponents)
        if unit.display is not None:
            name, factor = unit.display
            SubElement(entry, "DisplayUnit", name=name, factor=repr(factor))


def _add_experiment(root: Element) -> None:
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(_STOP_TIME),
        stepSize=repr(_STEP),
    )


def _add_fmi2_variable(listed: Element, variable: Variable, reference: int) -> None:
    entry = SubElement(
        listed,
        "ScalarVariable",
        name=variable.name,
        valueReference=str(reference),
        description=variable.description,
        causality=variable.causality,
        variability=variable.variability,
    )
    if variable.causality in ("output", "parameter"):
        entry.set("initial", _initial(variable))
    kind = SubElement(entry, _FMI2_TYPES[variable.kind])
    for name, value in _value_attributes(variable).items():
        kind.set(name, value)


def _add_fmi3_variable(listed: Element, variable: Variable, reference: int) -> None:
    entry = SubElement(
        listed,
        _FMI3_TYPES[variable.kind],
        name=variable.name,
        valueReference=str(reference),
        description=variable.description,
        causality=variable.causality,
        variability=variable.variability,
    )
    if variable.causality in ("output", "parameter"):
        entry.set("initial", _initial(variable))
    for name, value in _value_attributes(variable).items():
        entry.set(name, value)


def _initial(variable: Variable) -> str:
    return "exact" if variable.causality == "parameter" else "calculated"


def _value_attributes(variable: Variable) -> dict[str, str]:
    """Return unit, limits and start value as attributes."""
    attributes = {}
    if variable.unit is not None:
        attributes["unit"] = variable.unit.name
    if variable.limits is not None:
        low, high = variable.limits
        attributes["min"] = repr(low)
        attributes["max"] = repr(high)
    if variable.start is not None:
        attributes["start"] = repr(variable.start)
    return attributes


def _text(root: Element) -> str:
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'
