# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The registry of quantities: what hmcvt knows of each, apart from the physics that predict it.

One entry makes a quantity a column of bench files and a field of `BenchSamples`, with its range, a
column that the import of tables recognises, a joint of bench messages and a column of the bench
log, and a row of the documentation. An entry with `channel` is also predicted, by the function of
its name in `physics/readings.py`, and compared with the model.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from numbers import Real
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError

PAPER_EFFICIENCY_UNCERTAINTY = 0.0112
"""Total relative uncertainty of the paper's efficiency readings, eq. (3) [-]."""
_PLAIN_NUMBERS = frozenset((float, int, np.float64, np.float32, np.int64, np.int32))
"""Types of which a list holds numbers alone, seen at once."""


def real_numbers(value: ArrayLike, name: str, hint: str = "") -> NDArray[np.float64]:
    """Return numbers as an array of floats.

    NumPy would read a text as its number, True as 1, and drop imaginary parts and masks.

    Args:
        value: scalar or array of any shape.
        name: what the error calls it.
        hint: what the error adds.

    Raises:
        InputError: it holds a text, a truth value, a complex number or a masked value.
    """
    array = None
    # Lists that do not form an array, and integers beyond any float, are none either.
    with contextlib.suppress(TypeError, ValueError, OverflowError):
        if holds_numbers(value):
            array = np.asarray(value, dtype=float)
    if array is None:
        raise InputError(f"{name} = {value!r} is not a number{hint}")
    if np.ma.is_masked(value):
        raise InputError(f"{name} has masked values; leave them out")
    return array


def holds_numbers(value: ArrayLike) -> bool:
    """Whether a value holds real numbers alone; None, which is NaN, counts as one."""
    if isinstance(value, list | tuple):
        types = set(map(type, value))
        return types <= _PLAIN_NUMBERS or all(map(holds_numbers, value))
    array = np.asarray(value)
    if array.dtype.kind == "O":
        return all(map(_is_number, array.flat))
    return array.dtype.kind in "iuf"


def _is_float(item: Any) -> TypeGuard[float]:
    return isinstance(item, float)


def _is_number(item: object) -> bool:
    return item is None or (isinstance(item, Real) and not isinstance(item, bool))


@dataclass(frozen=True)
class Range:
    """A closed interval of one physical quantity.

    Attributes:
        name: the quantity, as it is called in files and arguments.
        low: lowest value, in `unit`.
        high: highest value, in `unit`.
        unit: the unit, `-` for a plain number.
        hint: what to suspect when a value is outside.
        signed: whether the negative interval is allowed too, for rotation backward.
    """

    name: str
    low: float
    high: float
    unit: str
    hint: str = ""
    signed: bool = False

    def __str__(self) -> str:
        text = f"{self.low:g} to {self.high:g}"
        if self.unit != "-":
            text = f"{text} {self.unit}"
        if self.signed:
            text = f"{text}, negative backward"
        return text

    def contains(self, value: ArrayLike) -> NDArray[np.bool_]:
        """Return, element by element, which values are finite and inside."""
        array = self._magnitude(np.asarray(value, dtype=float))
        return (array >= self.low) & (array <= self.high)

    def _magnitude(self, array: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the limits hold for: the values, or their magnitudes."""
        return np.abs(array) if self.signed else array

    def check(self, value: ArrayLike, where: str = "") -> NDArray[np.float64]:
        """Return `value` as an array of floats.

        Args:
            value: scalar or array of any shape, in `unit`.
            where: the place to name in the error, such as a file and row.

        Raises:
            InputError: a value is no number (a text, a truth value, a complex number), not finite
                or outside; the first one is named.
        """
        # A plain number within the range needs no further look; many are checked in a search.
        if _is_float(value) and not self.signed and self.low <= value <= self.high:
            return np.array(value)
        prefix = f"{where}: " if where else ""
        array = real_numbers(value, f"{prefix}{self.name}", f"; allowed {self}")
        # One pass each and false for NaN; cheaper than a mask when all is well.
        sizes = self._magnitude(array)
        if sizes.size and not (sizes.min() >= self.low and sizes.max() <= self.high):
            first = np.flatnonzero(~self.contains(array).ravel())[0]
            index = f"[{first}]" if array.ndim else ""
            raise InputError(f"{prefix}{self.complaint(array.ravel()[first], index)}")
        return array

    def complaint(self, value: float, index: str = "") -> str:
        """Return in one line what is wrong with a value outside."""
        if not np.isfinite(value):
            return f"{self.name}{index} = {value} is not finite; allowed {self}"
        hint = f" ({self.hint})" if self.hint else ""
        text = f"{value:g}"
        if self.contains(float(text)):
            text = repr(float(value))  # just beyond a limit, and inside once rounded
        return f"{self.name}{index} = {text} is outside {self}{hint}"


@dataclass(frozen=True)
class Heading:
    """A heading of a table that names a quantity; words mean what `hmcvt_tools.tables.rules` lists.

    Attributes:
        side: `engine`, `output` or `load` of the transmission; `""` where none applies.
        needs: further meanings of which the heading has one; empty for none.
        excludes: meanings that the heading must not have.
    """

    side: str = ""
    needs: tuple[str, ...] = ()
    excludes: tuple[str, ...] = ("std",)


@dataclass(frozen=True)
class Reading:
    """How a channel is printed, its noise and its priors; see `diagnosis.system.Channel`."""

    unit: str
    factor: float
    digits: int
    uncertainty: float
    relative: bool
    field_spreads: tuple[float, ...]
    step_spreads: tuple[float, ...]
    misfit_spread: float
    least: float = 0.0
    served: bool = True


@dataclass(frozen=True)
class Gauge:
    """Errors of what reads a quantity, as standard deviations.

    Attributes:
        name: in words.
        gain: relative error [-].
        zero: error at any reading, in the unit of the quantity; 0 for none.
        by_session: whether they differ from session to session. The errors are then shared by the
            readings of a session; otherwise they are constant, and every fit adjusts them.
    """

    name: str
    gain: float
    zero: float = 0.0
    by_session: bool = False


@dataclass(frozen=True)
class Quantity(Range):
    """One quantity that enters from outside.

    Attributes:
        kind: what it measures, one of `hmcvt_tools.tables.rules.KINDS`; decides units and headings.
        symbol: in formulas; empty for none.
        meaning: what it is, for the documentation.
        headings: of a table that name it, any of them.
        words: of a heading, in any language, that mean this quantity and no other: its name is
            the meaning that headings need or exclude. `words.WORDS` holds those that several share.
        stored: whether bench files hold it. The others only serve to compute what is stored.
        required: whether every bench file holds it.
        joint: whether a bench message states it, by the `position` of a joint of its name, instead
            of by the shafts or its header; of those that are stored.
        averaged: whether the import of a recording averages it over a steady window.
        missing: what a diagnosis lacks without it; empty for nothing worth a remark.
        channel: how it is compared with the model; None where it is not predicted.
        gauge: errors of what reads it; None where no fit adjusts any. Those of a quantity that a
            test sets are by session.
    """

    kind: str = ""
    symbol: str = ""
    meaning: str = ""
    headings: tuple[Heading, ...] = (Heading(),)
    words: str = ""
    stored: bool = True
    required: bool = False
    joint: bool = True
    averaged: bool = False
    missing: str = ""
    channel: Reading | None = None
    gauge: Gauge | None = None


# The order is that of the columns of bench files, and of the options of `hmcvt import`.
QUANTITIES: tuple[Quantity, ...] = (
    Quantity(
        name="displacement_ratio",
        low=-1.0,
        high=1.0,
        unit="-",
        hint="a fraction of full pump stroke, not percent",
        kind="stroke",
        symbol="eps",
        meaning="commanded stroke of the pump as a fraction of full stroke",
        required=True,
        joint=False,
        averaged=True,
        # Of full stroke; calibrations of the sensor of the plate agree to 0.2 to 0.5 %.
        gauge=Gauge("stroke sensor", gain=0.003, zero=0.003, by_session=True),
    ),
    Quantity(
        name="engine_speed",
        low=10.0,
        high=320.0,
        unit="rad/s",
        hint="is it in r/min?",
        kind="speed",
        symbol="omega_e",
        meaning="speed of the engine shaft",
        headings=(Heading("engine"),),
        required=True,
        joint=False,
        averaged=True,
    ),
    Quantity(
        name="engine_torque",
        low=0.1,
        high=20_000.0,
        unit="N m",
        hint="positive in forward driving",
        kind="torque",
        symbol="T_e",
        meaning="torque of the engine shaft; with output torque and speed it gives the "
        "efficiency",
        headings=(Heading("engine", excludes=("std", "loss")),),
        stored=False,
    ),
    Quantity(
        name="output_torque",
        low=0.1,
        high=20_000.0,
        unit="N m",
        hint="with the sign of the output speed where the output is driven",
        signed=True,
        kind="torque",
        symbol="T_out",
        meaning="torque at the output shaft; negative in reverse driving",
        headings=(Heading("output", excludes=("std", "loss")),),
        stored=False,
    ),
    Quantity(
        name="load_torque",
        low=1.0,
        high=5000.0,
        unit="N m",
        hint="output power / engine speed",
        kind="torque",
        symbol="L",
        meaning="output power / engine speed",
        headings=(Heading("load", excludes=("std", "loss")),),
        required=True,
        joint=False,
        averaged=True,
    ),
    Quantity(
        name="torque_loss",
        low=0.0,
        high=20_000.0,
        unit="N m",
        hint="not negative",
        kind="torque",
        meaning="loss of engine torque, at the input shaft; gives the load torque",
        headings=(Heading(needs=("loss",), excludes=("std", "output", "load")),),
        stored=False,
    ),
    Quantity(
        name="engine_power",
        low=10.0,
        high=2e6,
        unit="W",
        hint="positive in forward driving",
        kind="power",
        symbol="P_e",
        meaning="power of the engine shaft",
        headings=(Heading("engine"),),
        stored=False,
    ),
    Quantity(
        name="output_power",
        low=10.0,
        high=2e6,
        unit="W",
        hint="positive in forward driving",
        kind="power",
        symbol="P_out",
        meaning="power of the output shaft",
        headings=(Heading("output"), Heading("load")),
        stored=False,
    ),
    Quantity(
        name="efficiency",
        low=0.01,
        high=1.0,
        unit="-",
        hint="a fraction, not percent",
        kind="efficiency",
        symbol="eta",
        meaning="output power / engine power",
        headings=(Heading(excludes=("std", "pump", "engine")),),
        required=True,
        joint=False,
        averaged=True,
        channel=Reading(
            unit="points",
            factor=100.0,
            digits=2,
            uncertainty=PAPER_EFFICIENCY_UNCERTAINTY,
            relative=False,
            field_spreads=(0.003, 0.01, 0.03),
            step_spreads=(0.01, 0.03),
            misfit_spread=0.0012,
        ),
        # Of both torques together, each of class 0.1 (VDI/VDE 2646): 0.1 % sqrt(2 / 3). Their
        # zeros, drift and hysteresis are in `benches/transmission/meters.py`.
        gauge=Gauge("meters", gain=0.0008, by_session=True),
    ),
    Quantity(
        name="output_speed",
        low=0.1,
        high=1000.0,
        unit="rad/s",
        hint="is it in r/min?",
        signed=True,
        kind="speed",
        symbol="omega_out",
        meaning="speed of the output shaft; negative backward",
        headings=(Heading("output"), Heading("load")),
        joint=False,
        averaged=True,
        missing="losses of flow and of torque look alike",
        # Speed losses are relative, as the noise is. At the same load a speed loss raises the
        # torque by the same fraction, so that it lowers the efficiency too.
        channel=Reading(
            unit="rad/s",
            factor=1.0,
            digits=2,
            uncertainty=0.001,
            relative=True,
            field_spreads=(0.001, 0.004, 0.016),
            step_spreads=(0.01, 0.03),
            misfit_spread=0.0004,
            served=False,
        ),
        # Time base and mounting of an encoder; chosen, half of the scatter of a reading.
        gauge=Gauge("speed meter", gain=0.0005, by_session=True),
    ),
    Quantity(
        name="oil_temperature",
        low=-40.0,
        high=150.0,
        unit="deg C",
        hint="is it in kelvin?",
        kind="temperature",
        symbol="theta",
        meaning="temperature of the oil",
        headings=(Heading(excludes=("std", "engine")),),
        averaged=True,
        missing="viscosity and a fan cannot be judged",
    ),
    Quantity(
        name="efficiency_std",
        low=1e-6,
        high=0.2,
        unit="-",
        hint="a fraction, not percent",
        kind="efficiency",
        symbol="sigma_eta",
        meaning="standard deviation of the efficiency of this test",
        headings=(Heading(needs=("std",), excludes=()),),
    ),
    Quantity(
        name="stamp",
        low=0.0,
        high=1e12,
        unit="s",
        kind="time",
        symbol="t",
        meaning="time of the test",
        headings=(Heading(excludes=("std", "engine")),),
        joint=False,
        averaged=True,
    ),
    Quantity(
        name="pressure",
        low=-6e7,
        high=6e7,
        unit="Pa",
        hint="high less low side of the motor",
        kind="pressure",
        symbol="dp",
        meaning="pressure over the motor, high side minus low side",
        headings=(
            Heading(excludes=("std", "charge_pressure", "engine", "oil", "output")),
        ),
        # ISO 4409 class A: 0.5 % of the reading. Near zero a 40 MPa gauge resolves about
        # 0.05 MPa.
        channel=Reading(
            unit="MPa",
            factor=1e-6,
            digits=2,
            uncertainty=0.005,
            relative=False,
            field_spreads=(1e5, 4e5, 1.6e6),
            step_spreads=(4e5, 1.2e6),
            misfit_spread=5e4,
            least=5e4,
            served=False,
        ),
        # Gauge and displacement of the motor together (ISO 4409, ISO 8426).
        gauge=Gauge("pressure gauge", gain=0.01, zero=1e5),
    ),
    Quantity(
        name="charge_pressure",
        low=-1e5,
        high=1e7,
        unit="Pa",
        hint="is it in bar?",
        kind="pressure",
        symbol="p_c",
        meaning="pressure of the charge circuit; recorded with the test, no model reads it",
        headings=(
            Heading(needs=("charge_pressure",), excludes=("std", "engine", "boost")),
        ),
        words="feed boost speise speisedruck lade ladedruck fuelldruck gavage suralimentation "
        "alimentation admission admision aspirazione sovralimentazione sobrealimentacion "
        "\u8865\u6cb9 \u8865\u6cb9\u538b\u529b",
        averaged=True,
    ),
)
"""Every quantity of a bench."""

BY_NAME = {quantity.name: quantity for quantity in QUANTITIES}
STORED = tuple(quantity for quantity in QUANTITIES if quantity.stored)
"""The columns of a bench file, in their order."""
PREDICTED = tuple(quantity for quantity in STORED if quantity.channel is not None)
"""The quantities that the model predicts and a bench may read; the efficiency is the first."""
