# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The C source and header of a model."""

import math
import textwrap
from collections.abc import Sequence
from importlib.resources import files
from string import Template
from typing import Any, NamedTuple

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.model import optimum
from hmcvt_core.model.domain import AXES
from hmcvt_core.model.intervals import half_width
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.physics.steady_state import MOTOR_REST_BOUND, ROUNDING
from hmcvt_core.transmission import ranges
from hmcvt_core.transmission.parameters import PARAMETER_RANGES
from hmcvt_core.transmission.ranges import Range
from hmcvt_core.version import __version__

from . import c_text
from .constants import StageFactors, stage_factors
from .effect_tables import (
    BOUND,
    TABLE_LOAD,
    TABLE_SPEED,
    TABLES_REMARK,
    Accuracy,
    EffectTable,
    departs_from_closed_form,
    effect_tables,
)

PRECISIONS = ("double", "single")
MODEL_HEADER = "hmcvt_model.h"
MODEL_SOURCE = "hmcvt_model.c"

_EXACT = "Double precision gives what Python gives, bit by bit."
BOUND_RANGE = Range("bound", 1e-4, 0.1, "-", "an error of the efficiency, 0.002")
_SHIFT_STEPS = 12
_SHIFT_TOLERANCE = 1e-6  # of the stroke


class CModel(NamedTuple):
    """A model as C.

    Attributes:
        header: text of hmcvt_model.h.
        source: text of hmcvt_model.c.
        effects: a table for each stage; empty without effects.
        accuracy: of these tables; None without effects, where the answers are those of Python.
    """

    header: str
    source: str
    effects: Sequence[EffectTable]
    accuracy: Accuracy | None


class _Ranges(NamedTuple):
    """Ranges of the inputs."""

    engine_speed: Range
    load: Range
    pull: Range


_CLOSED_FORM_RANGES = _Ranges(ranges.ENGINE_SPEED, ranges.ANY_LOAD, ranges.LOAD_TORQUE)
_TABLE_RANGES = _Ranges(
    TABLE_SPEED,
    TABLE_LOAD,
    Range("load_torque", ranges.LOAD_TORQUE.low, TABLE_LOAD.high, "N m"),
)


def template(name: str) -> Template:
    """Return a template of this package."""
    return Template((files(__package__) / "templates" / name).read_text("utf-8"))


def require_exportable(model: EfficiencyModel) -> None:
    """Raise an `InputError` where a model has no form outside Python."""
    if model.formulation != "power_balance":
        raise InputError(
            f"formulation {model.formulation!r} is not exported: it holds only in part of "
            "the working range; take power_balance"
        )


def c_model(
    model: EfficiencyModel, precision: str = "double", bound: float = BOUND
) -> CModel:
    """Return a model as C.

    Args:
        model: all its stages are exported.
        precision: `double` or `single`.
        bound: error of the efficiency that tables of effects may make [-].

    Raises:
        InputError: the formulation is not `power_balance`, the precision is unknown, or the bound
            asks for too large a table.
    """
    require_exportable(model)
    if precision not in PRECISIONS:
        raise InputError(f"precision = {precision!r}; there is {', '.join(PRECISIONS)}")
    BOUND_RANGE.check(bound)
    tables: list[EffectTable] = []
    accuracy = None
    limits = _CLOSED_FORM_RANGES
    guarantee = _EXACT
    if departs_from_closed_form(model):
        tables, accuracy = effect_tables(model, bound)
        limits = _TABLE_RANGES
        guarantee = f"The model holds {accuracy.report()}. {TABLES_REMARK}"
    values = _shared_values(model)
    header = template(MODEL_HEADER).substitute(
        values,
        single=int(precision == "single"),
        guarantee=_wrapped(guarantee),
        **_header_values(model, limits),
    )
    source = template(MODEL_SOURCE).substitute(
        values, **_source_values(model, limits, tables)
    )
    return CModel(header, source, tables, accuracy)


def _wrapped(text: str) -> str:
    """Return text as lines of a block comment."""
    return "\n * ".join(textwrap.wrap(text, 96))


def _shared_values(model: EfficiencyModel) -> dict[str, Any]:
    return {
        "fingerprint": model.fingerprint,
        "version": __version__,
        "stages": len(model.stages),
    }


def _header_values(model: EfficiencyModel, limits: _Ranges) -> dict[str, Any]:
    """Return what the header says of stages and ranges."""
    leakage, damping, _ = PARAMETER_RANGES
    names = []
    for number, name in enumerate(model.stages):
        names.append(f" {number} {c_text.comment(name)}")
    error_remark = "no parameter matters"
    if not model.states_errors:
        error_remark = "not known, which is everywhere: the model states no errors"
    return {
        "stage_list": ",".join(names),
        "leakage_range": f"{leakage.low:g} to {leakage.high:g}",
        "damping_range": f"{damping.low:g} to {damping.high:g}",
        "displacement_ratio_range": str(ranges.DISPLACEMENT_RATIO),
        "engine_speed_range": str(limits.engine_speed),
        "load_torque_range": str(limits.load),
        "pull_range": str(limits.pull),
        "output_speed_range": str(ranges.OUTPUT_SPEED),
        "error_remark": error_remark,
    }


def _source_values(
    model: EfficiencyModel, limits: _Ranges, effects: Sequence[EffectTable]
) -> dict[str, Any]:
    """Return tables and constants of the source."""
    stages = [stage_factors(part.stage) for part in model.stages.values()]
    leakage, damping, _ = PARAMETER_RANGES
    return {
        "pump_at_engine": int(any(not stage.pump_on_row for stage in stages)),
        "pump_on_row": int(any(stage.pump_on_row for stage in stages)),
        "states_errors": int(model.states_errors),
        "states_domain": int(model.domain is not None),
        "states_effects": int(bool(effects)),
        "tables": _tables(model, stages, effects),
        "rounding": ROUNDING,
        "motor_at_rest": MOTOR_REST_BOUND,
        "leakage_low": leakage.low,
        "leakage_high": leakage.high,
        "damping_low": damping.low,
        "damping_high": damping.high,
        "engine_speed_low": limits.engine_speed.low,
        "engine_speed_high": limits.engine_speed.high,
        "load_low": limits.load.low,
        "load_high": limits.load.high,
        "pull_low": limits.pull.low,
        "pull_high": limits.pull.high,
        "output_speed_low": ranges.OUTPUT_SPEED.low,
        "output_speed_high": ranges.OUTPUT_SPEED.high,
        "output_power_high": optimum.OUTPUT_POWER.high,
        **_search_values(),
    }


def _search_values() -> dict[str, Any]:
    """Return the settings of the searches, those of Python."""
    widest = 2.0 / optimum.PARTS
    shrinkage = math.log(optimum.BRACKET / widest) / math.log(optimum.GOLDEN)
    return {
        "parts": optimum.PARTS,
        "golden": repr(optimum.GOLDEN),
        "golden_steps": math.ceil(shrinkage) + 1,
        "bracket": optimum.BRACKET,
        "start": optimum.START,
        "scan_steps": optimum.SCAN - 1,
        "grids": optimum.ZOOMS + 1,
        "slip": optimum.SLIP,
        "edge": optimum.EDGE,
        "next_to_rest": optimum.NEXT_TO_REST,
        "shift_steps": _SHIFT_STEPS,
        "shift_tolerance": _SHIFT_TOLERANCE,
    }


def _tables(
    model: EfficiencyModel,
    stages: Sequence[StageFactors],
    effects: Sequence[EffectTable],
) -> str:
    parts = [c_text.stage_tables(stages, effects)]
    names = ", ".join(c_text.string(stage.name) for stage in stages)
    parts.append(f"const char *const hmcvt_stage_names[HMCVT_STAGES] = {{{names}}};\n")
    parts.append(
        f"const char hmcvt_fingerprint[] = {c_text.string(model.fingerprint)};\n"
    )
    parameters = c_text.numbers(model.parameters.to_array().tolist())
    parts.append(
        f"const hmcvt_parameters hmcvt_identified_parameters = {parameters};\n"
    )
    half = c_text.literal(half_width(model.degrees_of_freedom))
    parts.append(f"const hmcvt_real hmcvt_interval_90 = {half};\n")
    if model.states_errors:
        parts.append(_error_tables(model))
    if model.domain is not None:
        parts.append(_domain_table(model))
    return "\n".join(parts)


def _error_tables(model: EfficiencyModel) -> str:
    """Return steps of the parameters, errors in such steps, correlation and squared misfit."""
    base = model.parameters.to_array()
    counts = []
    steps = []
    for position, (count, neighbour) in enumerate(model.neighbours):
        counts.append(count)
        value = neighbour.parameters.to_array()[position]
        steps.append(float(value - base[position]))
    rows = []
    for row in np.asarray(model.correlation).tolist():
        rows.append("    " + c_text.numbers(row))
    return (
        "/* Step of each parameter, its standard error in such steps, their correlation, and the\n"
        " * variance of what the model misses. */\n"
        f"static const hmcvt_real parameter_steps[3] = {c_text.numbers(steps)};\n"
        f"static const hmcvt_real error_steps[3] = {c_text.numbers(counts)};\n"
        "static const hmcvt_real correlation[3][3] = {\n"
        + ",\n".join(rows)
        + "\n};\n"
        + f"static const hmcvt_real misfit_squared = {c_text.literal(model.misfit**2)};\n"
    )


def _domain_table(model: EfficiencyModel) -> str:
    domain = model.domain
    assert domain is not None
    rows = []
    for axis in AXES:
        rows.append("    " + c_text.numbers(domain.limits_with_slack(axis)))
    return (
        "/* Data of the identification: displacement ratio, engine speed, load torque. */\n"
        "static const hmcvt_real domain[3][2] = {\n" + ",\n".join(rows) + "\n};\n"
    )
