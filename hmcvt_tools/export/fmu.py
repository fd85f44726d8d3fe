# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The FMU that `export_fmu` writes: description, sources and binaries in one archive."""

import importlib.util
import io
import os
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from hmcvt_core.errors import HmcvtError, InputError
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.model.model import EfficiencyModel

from .c_model import (
    MODEL_HEADER,
    MODEL_SOURCE,
    CModel,
    c_model,
    require_exportable,
    template,
)
from .compiler import Target, build_shared, targets
from .effect_tables import BOUND, TABLES_REMARK, Accuracy
from .fmi_description import (
    Identity,
    build_description,
    fmi2_description,
    fmi3_description,
)
from .fmi_variables import Variable, fmu_variables
from .stage_choice import stage_choice_sources

VERSIONS = (2, 3)
_IDENTIFIER = "hmcvt_"
_UNIT_HEADER = "hmcvt_unit.h"
_UNIT_SOURCE = "hmcvt_unit.c"
_NAMESPACE = uuid.UUID("6f0cf6b3-5d0f-4a0c-9c53-0d7d4c3cf1b5")
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every file in the archive: the same model gives the same bytes."""


def export_fmu(
    model: EfficiencyModel,
    path: str | os.PathLike[str],
    fmi: int = 2,
    bound: float = BOUND,
) -> Accuracy | None:
    """Write a model as an FMU for co-simulation and model exchange.

    It holds the sources and a binary for this machine, and one for 64-bit Windows where
    x86_64-w64-mingw32-gcc is installed. A file of that name is replaced.

    Args:
        model: all its stages are exported; the input `stage` numbers them from 0.
        path: file to write.
        fmi: version of the standard, 2 or 3.
        bound: error of the efficiency that tables of effects may make [-].

    Returns:
        What the tables of effects keep, or None without effects.

    Raises:
        InputError: the model cannot be exported, there is no C compiler, or FMPy is missing.
    """
    require_exportable(model)
    _tools(path, fmi)  # what lacks is refused before the work
    code = c_model(model, bound=bound)
    write_fmu(model, code, path, fmi)
    return code.accuracy


def write_fmu(
    model: EfficiencyModel,
    code: CModel,
    path: str | os.PathLike[str],
    fmi: int = 2,
) -> None:
    """Write an FMU of the C of a model, as `export_fmu` does.

    Args:
        model: all its stages are exported.
        code: of the model, in double precision.
        path: file to write.
        fmi: version of the standard, 2 or 3.

    Raises:
        InputError: there is no C compiler, or FMPy is missing.
    """
    headers, machines = _tools(path, fmi)
    write_atomically(Path(path), _content(model, code, fmi, headers, machines))


def _tools(path: str | os.PathLike[str], fmi: int) -> tuple[Path, list[Target]]:
    """Return the folder of the headers of the standard and the machines to build for.

    Raises:
        InputError: the version is unknown, the path is a folder, there is no C compiler, or FMPy
            is missing.
    """
    if fmi not in VERSIONS:
        raise InputError(f"fmi = {fmi!r}; there is {', '.join(map(str, VERSIONS))}")
    if Path(path).is_dir():
        raise InputError(f"{path}: is a folder")
    return _fmi_headers(), targets()


def _content(
    model: EfficiencyModel,
    code: CModel,
    fmi: int,
    headers: Path,
    machines: Sequence[Target],
) -> bytes:
    """Return the archive of a model, which FMPy finds valid."""
    variables = fmu_variables(model, code.accuracy is not None)
    identifier = f"{_IDENTIFIER}{model.fingerprint}"
    texts = _sources(code, variables, identifier, fmi)
    names = [name for name in texts if name.endswith(".c")]
    identity = Identity(_token(texts), identifier, _description(model, code))
    entries = _descriptions(variables, identity, names, fmi)
    for name, text in texts.items():
        entries[f"sources/{name}"] = text.encode()
    for machine in machines:
        folder = machine.fmi2 if fmi == 2 else machine.fmi3
        binary = f"binaries/{folder}/{identifier}{machine.suffix}"
        entries[binary] = _binary(machine, texts, names, headers)
    content = _archive(entries)
    _require_valid(content)
    return content


def _description(model: EfficiencyModel, code: CModel) -> str:
    """Return one line for the user of the FMU."""
    text = f"Efficiency of a hydromechanical CVT: model {model.fingerprint}"
    if code.accuracy is None:
        return text
    return f"{text}; {code.accuracy.report()}. {TABLES_REMARK}"


def _fmi_headers() -> Path:
    """Return the folder with the headers of FMI, which FMPy holds."""
    package = importlib.util.find_spec("fmpy")
    if package is None or package.origin is None:
        raise InputError(
            "an FMU needs the headers of FMI, which FMPy holds: pip install "
            '"hmcvt_ros[export]"'
        )
    return Path(package.origin).parent / "c-code"


def _sources(
    code: CModel, variables: Sequence[Variable], identifier: str, fmi: int
) -> dict[str, str]:
    """Return the text of each source by file name; the token follows from them."""
    references = []
    starts = {}
    for reference, variable in enumerate(variables):
        references.append(f"    {variable.name.upper()} = {reference}")
        if variable.start is not None:
            starts[f"start_{variable.name}"] = repr(variable.start)
    texts = {
        MODEL_HEADER: code.header,
        MODEL_SOURCE: code.source,
        **stage_choice_sources(identifier.removeprefix(_IDENTIFIER)),
        _UNIT_SOURCE: template(_UNIT_SOURCE).substitute(starts),
        f"fmi{fmi}.c": template(f"fmi{fmi}.c").substitute(identifier=identifier),
    }
    token = _token(texts)
    texts[_UNIT_HEADER] = template(_UNIT_HEADER).substitute(
        token=token, references=",\n".join(references)
    )
    return texts


def _token(texts: Mapping[str, str]) -> str:
    """Return the identifier of the FMU; it changes with any line of its sources."""
    counted = [text for name, text in sorted(texts.items()) if name != _UNIT_HEADER]
    return str(uuid.uuid5(_NAMESPACE, "".join(counted)))


def _descriptions(
    variables: Sequence[Variable],
    identity: Identity,
    sources: Sequence[str],
    fmi: int,
) -> dict[str, bytes]:
    """Return the XML files by their names in the archive."""
    if fmi == 2:
        text = fmi2_description(variables, identity, sources)
        return {"modelDescription.xml": text.encode()}
    text = fmi3_description(variables, identity)
    build = build_description(identity.identifier, sources)
    return {
        "modelDescription.xml": text.encode(),
        "sources/buildDescription.xml": build.encode(),
    }


def _binary(
    machine: Target, texts: Mapping[str, str], sources: Sequence[str], headers: Path
) -> bytes:
    """Return the shared library of one kind of machine."""
    with TemporaryDirectory(prefix="hmcvt-") as name:
        folder = Path(name)
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8")
        result = folder / f"library{machine.suffix}"
        build_shared(machine, folder, sources, headers, result)
        return result.read_bytes()


def _archive(entries: Mapping[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries.items():
            information = zipfile.ZipInfo(name, _EPOCH)
            information.compress_type = zipfile.ZIP_DEFLATED
            information.external_attr = 0o644 << 16
            archive.writestr(information, content)
    return buffer.getvalue()


def _require_valid(content: bytes) -> None:
    """Raise an error where FMPy finds a fault."""
    from fmpy.validation import validate_fmu

    with TemporaryDirectory(prefix="hmcvt-") as name:
        path = Path(name) / "model.fmu"
        path.write_bytes(content)
        problems = validate_fmu(str(path))
    if problems:
        raise HmcvtError(f"the FMU is not valid: {problems[0]}")
