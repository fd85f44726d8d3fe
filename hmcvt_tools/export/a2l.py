# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Adjustable parameters and outputs as A2L (ASAM MCD-2 MC), for calibration tools.

Addresses are zero and every object carries its symbol: a calibration tool takes the addresses from
the linker map of the program.
"""

from collections.abc import Iterator
from typing import NamedTuple

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission.parameters import PARAMETER_RANGES

_TYPES = {"double": "FLOAT64_IEEE", "single": "FLOAT32_IEEE"}
_SIZES = {"double": 8, "single": 4}
_SPEED_LIMIT = 10_000.0  # [rad/s]
_TORQUE_LIMIT = 100_000.0  # [N m]
_POWER_LIMIT = 1e8  # [W]
_LEAKAGE_UNIT = "cm3/(min bar)"
_LEAKAGE_FACTOR = "6e12"
"""Leakage in cm3/(min bar) by that in m3/(s Pa): 1e6 cm3/m3, 60 s/min, 1e5 Pa/bar."""


class _Measurement(NamedTuple):
    """One member of hmcvt_prediction."""

    name: str
    text: str
    unit: str
    low: float
    high: float


_MEASUREMENTS = (
    _Measurement("efficiency", "Efficiency of the transmission", "-", 0.0, 1.0),
    _Measurement(
        "output_speed",
        "Speed of the output shaft",
        "rad/s",
        -_SPEED_LIMIT,
        _SPEED_LIMIT,
    ),
    _Measurement(
        "engine_torque", "Torque of the engine", "N m", -_TORQUE_LIMIT, _TORQUE_LIMIT
    ),
    _Measurement(
        "power_loss",
        "Engine power less output power",
        "W",
        -_POWER_LIMIT,
        _POWER_LIMIT,
    ),
)


def a2l_text(model: EfficiencyModel, precision: str) -> str:
    """Return the A2L description of an exported model.

    Args:
        model: gives values and fingerprint.
        precision: `double` or `single`.
    """
    kind = _TYPES[precision]
    lines = [
        "ASAP2_VERSION 1 71",
        "/begin PROJECT hmcvt_project "
        + _quoted("Efficiency of a hydromechanical CVT"),
        "  /begin MODULE hmcvt_model " + _quoted(f"model {model.fingerprint}"),
        '    /begin MOD_COMMON ""',
        "      BYTE_ORDER MSB_LAST",
        f"      ALIGNMENT_FLOAT32_IEEE {_SIZES['single']}",
        f"      ALIGNMENT_FLOAT64_IEEE {_SIZES['double']}",
        "    /end MOD_COMMON",
        "    /begin RECORD_LAYOUT hmcvt_value",
        f"      FNC_VALUES 1 {kind} COLUMN_DIR DIRECT",
        "    /end RECORD_LAYOUT",
    ]
    lines += _characteristics(model, precision)
    lines += _measurements(kind, precision)
    lines += ["  /end MODULE", "/end PROJECT"]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return '"' + text.replace('"', "'") + '"'


def _conversion(name: str, unit: str) -> list[str]:
    """Return an identical conversion that states a unit."""
    return [
        f"    /begin COMPU_METHOD {name} " + _quoted(f"identical, in {unit}"),
        f"      IDENTICAL {_quoted('%10.6')} {_quoted(unit)}",
        "    /end COMPU_METHOD",
    ]


def _scaled_conversion(name: str, unit: str, factor: str) -> list[str]:
    """Return a conversion that shows a value multiplied by a factor.

    Six decimals would show a leakage of 3e-11 as 0.

    Args:
        name: of the conversion.
        unit: shown.
        factor: shown value by stored value.
    """
    return [
        f"    /begin COMPU_METHOD {name} " + _quoted(f"shown in {unit}"),
        f"      RAT_FUNC {_quoted('%10.6')} {_quoted(unit)}",
        # Stored = (a x^2 + b x + c) / (d x^2 + e x + f) of the value x that is shown.
        f"      COEFFS 0 1 0 0 0 {factor}",
        "    /end COMPU_METHOD",
    ]


def _characteristics(model: EfficiencyModel, precision: str) -> Iterator[str]:
    """Yield one CHARACTERISTIC for each hydraulic parameter."""
    values = model.parameters.to_array().tolist()
    for position, limits in enumerate(PARAMETER_RANGES):
        conversion = f"hmcvt_unit_{limits.name}"
        symbol = f"hmcvt_calibration.{limits.name}"
        low, high = limits.low, limits.high
        if limits.name == "leakage":
            yield from _scaled_conversion(conversion, _LEAKAGE_UNIT, _LEAKAGE_FACTOR)
            # Limits of an object are in the unit shown.
            low *= float(_LEAKAGE_FACTOR)
            high *= float(_LEAKAGE_FACTOR)
        else:
            yield from _conversion(conversion, limits.unit)
        yield f"    /begin CHARACTERISTIC {symbol}"
        yield "      " + _quoted(f"identified: {values[position]!r} {limits.unit}")
        yield f"      VALUE 0x0 hmcvt_value 0 {conversion} {low!r} {high!r}"
        yield f"      SYMBOL_LINK {_quoted('hmcvt_calibration')} {position * _SIZES[precision]}"
        yield "    /end CHARACTERISTIC"


def _measurements(kind: str, precision: str) -> Iterator[str]:
    """Yield one MEASUREMENT for each output."""
    for position, output in enumerate(_MEASUREMENTS):
        conversion = f"hmcvt_unit_{output.name}"
        yield from _conversion(conversion, output.unit)
        yield f"    /begin MEASUREMENT hmcvt_output.{output.name} {_quoted(output.text)}"
        yield f"      {kind} {conversion} 0 0 {output.low!r} {output.high!r}"
        yield "      ECU_ADDRESS 0x0"
        yield f"      SYMBOL_LINK {_quoted('hmcvt_output')} {position * _SIZES[precision]}"
        yield "    /end MEASUREMENT"
    flag_offset = len(_MEASUREMENTS) * _SIZES[precision]
    yield from _conversion("hmcvt_unit_inside_domain", "-")
    yield "    /begin MEASUREMENT hmcvt_output.inside_domain " + _quoted(
        "1 where data of the identification cover the point"
    )
    yield "      SLONG hmcvt_unit_inside_domain 0 0 0 1"
    yield "      ECU_ADDRESS 0x0"
    yield f"      SYMBOL_LINK {_quoted('hmcvt_output')} {flag_offset}"
    yield "    /end MEASUREMENT"
