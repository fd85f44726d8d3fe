# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which change against a sound state is named, on simulated transmissions and pumps.

    python -m studies.baseline [--campaigns 4] [--sound 34] [--pumps 20] [--seed 5] [--jobs 2]

Transmissions are simulated from the served model itself, which is the easier case; pumps by simple
formulas. It prints the tables of docs/baseline.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import click
import numpy as np
from numpy.typing import NDArray

import hmcvt_core as hmcvt
from hmcvt_core.benches.unit import diagnose_unit
from hmcvt_core.benches.unit.samples import UnitSamples
from hmcvt_core.physics.effects.base import Effect
from hmcvt_core.physics.effects.hydraulic import OrificeLeakage, PressureLeakage
from hmcvt_core.physics.effects.mechanical import ChargePump, Churning, PlanetaryMesh
from hmcvt_core.physics.effects.wear import LaminarLeakage, ViscousDamping
from hmcvt_tools.fleet.executors import Processes
from studies.page import table

Array = NDArray[np.float64]

TRUTH = hmcvt.HydraulicParameters(2e-11, 0.12, 0.2)
SERVED = hmcvt.HydraulicParameters(1e-11, 0.1, 0.1)
"""Parameters of the model that is diagnosed: not those of the machine."""
CHANGED_TESTS = 24
SOUND_TESTS = 48
NOISE = 0.004
"""Of the efficiency of a transmission [-]; of flow and torque of a pump as a part of the ideal."""
SPEED_NOISE = 0.001
SOUND_SEED = 10_000
"""Added to the seed of the changed machine for that of its sound state."""
NONE = "none"

CHANGES: Mapping[str, tuple[Effect, ...]] = {
    "leakage grown by half": (LaminarLeakage(leakage=0.5 * TRUTH.leakage),),
    "damping of the pump grown by half": (
        ViscousDamping(damping=0.5 * TRUTH.pump_damping),
    ),
    "pressure leakage 1.5e-11 m3/(s Pa)": (PressureLeakage(leakage=1.5e-11),),
    "orifice leakage 1.5e-4 m3/s": (OrificeLeakage(flow=1.5e-4),),
    "planetary mesh 3 %": (PlanetaryMesh(0.03),),
    "churning 10 N m": (Churning(torque=10.0),),
    "charge pump 10 N m": (ChargePump(torque=10.0),),
    NONE: (),
}

PUMP_DISPLACEMENT = 71e-6 / (2.0 * np.pi)  # m3/rad
PUMP_LEAKAGE = 3e-12  # m3/(s Pa)
PUMP_DAMPING = 0.05  # N m s/rad
PUMP_FRICTION = 0.03
"""Torque lost / ideal torque."""
PUMP_CONSTANT_TORQUE = 4.0  # N m
PUMP_SPEEDS = (52.0, 272.0)  # rad/s
PUMP_PRESSURES = (4e6, 4e7)  # Pa
PUMP_CHANGES: Mapping[str, str] = {
    "leakage grown by half": "laminar_leakage",
    "orifice leak of 0.7 % of the largest flow": "orifice_leakage",
    "damping grown by half": "viscous_damping",
    "constant torque 5 N m": "constant_torque",
    "friction 2 %": "pressure_friction",
    NONE: "",
}
"""What changes, and the effect that names it."""


@dataclass(frozen=True)
class Case:
    """One machine that is compared with its sound state.

    Attributes:
        kind: `transmission` or `pump`.
        change: key of `CHANGES` or `PUMP_CHANGES`.
        seed: of operating points and noise.
    """

    kind: str
    change: str
    seed: int


@dataclass(frozen=True)
class Answer:
    """What a diagnosis says of a case.

    Attributes:
        case: that was diagnosed.
        first: whether the leading set is the change alone.
        component: part that holds the change, or None.
        verdict: of the diagnosis.
    """

    case: Case
    first: bool
    component: str | None
    verdict: str


def answered(case: Case) -> Answer:
    """Return the answer of the diagnosis to a case."""
    if case.kind == "pump":
        return _pump_answer(case)
    return _transmission_answer(case)


def _transmission_answer(case: Case) -> Answer:
    effects = CHANGES[case.change]
    changed = transmission_tests(effects, case.seed, CHANGED_TESTS)
    sound = transmission_tests((), SOUND_SEED + case.seed, SOUND_TESTS)
    diagnosis = hmcvt.diagnose(_model(SERVED), changed, baseline=sound, noise=NOISE)
    names = tuple(effect.name for effect in effects)
    return _answer(case, diagnosis, names)


def _pump_answer(case: Case) -> Answer:
    changed = pump_tests(case.change, case.seed, (6, 4))
    sound = pump_tests(NONE, SOUND_SEED + case.seed, (8, 6))
    diagnosis = diagnose_unit(changed, baseline=sound).diagnosis
    return _answer(case, diagnosis, (PUMP_CHANGES[case.change],))


def _answer(case: Case, diagnosis: hmcvt.Diagnosis, effects: tuple[str, ...]) -> Answer:
    first = bool(diagnosis.sets) and diagnosis.sets[0].effects == effects
    return Answer(case, first, diagnosis.component, diagnosis.verdict)


def _model(parameters: hmcvt.HydraulicParameters) -> hmcvt.EfficiencyModel:
    stage = hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml"))
    return hmcvt.EfficiencyModel(stage, parameters)


def transmission_tests(
    effects: tuple[Effect, ...], seed: int, count: int
) -> hmcvt.BenchSamples:
    """Return tests of a transmission with some effects, all over the working range."""
    rng = np.random.default_rng(seed)
    stroke = rng.uniform(-1.0, 1.0, count)
    speed = rng.uniform(78.5, 230.0, count)
    load = np.clip(rng.uniform(18e3, 85e3, count) / speed, 40.0, 600.0)
    machine = replace(_model(TRUTH), effects=effects)
    efficiency = machine.efficiency(stroke, speed, load)
    output_speed = machine.output_speed(stroke, speed, load)
    carried = np.isfinite(efficiency)
    efficiency = efficiency + NOISE * rng.standard_normal(count)
    output_speed = output_speed * (1.0 + SPEED_NOISE * rng.standard_normal(count))
    return hmcvt.BenchSamples(
        stroke[carried],
        speed[carried],
        load[carried],
        efficiency[carried],
        output_speed=output_speed[carried],
        source="simulated",
    )


def pump_tests(change: str, seed: int, levels: tuple[int, int]) -> UnitSamples:
    """Return tests of flow and torque of a pump on a grid of speeds and pressures.

    Args:
        change: key of `PUMP_CHANGES`.
        seed: of the noise.
        levels: number of pressures and of speeds.
    """
    rng = np.random.default_rng(seed)
    grid = np.meshgrid(
        np.linspace(*PUMP_PRESSURES, levels[0]), np.linspace(*PUMP_SPEEDS, levels[1])
    )
    pressure, speed = (values.ravel() for values in grid)
    ideal_flow = PUMP_DISPLACEMENT * speed
    ideal_torque = PUMP_DISPLACEMENT * pressure
    flow, torque = _pump_losses(change, speed, pressure)
    flow += NOISE * ideal_flow * rng.standard_normal(len(speed))
    torque += NOISE * ideal_torque * rng.standard_normal(len(speed))
    return UnitSamples(
        "pump",
        PUMP_DISPLACEMENT,
        np.ones(len(speed)),
        speed,
        pressure,
        flow,
        torque,
        noise=NOISE,
        source="simulated",
    )


def _pump_losses(change: str, speed: Array, pressure: Array) -> tuple[Array, Array]:
    """Return lost flow [m3/s] and torque [N m] of a pump with a change."""
    flow = PUMP_LEAKAGE * pressure
    viscous = PUMP_DAMPING * speed
    torque = viscous + PUMP_FRICTION * PUMP_DISPLACEMENT * pressure
    torque = torque + PUMP_CONSTANT_TORQUE
    if change == "leakage grown by half":
        flow = 1.5 * flow
    elif change == "orifice leak of 0.7 % of the largest flow":
        largest = PUMP_DISPLACEMENT * PUMP_SPEEDS[1]
        flow = flow + 0.007 * largest * np.sqrt(pressure / PUMP_PRESSURES[1])
    elif change == "damping grown by half":
        torque = torque + 0.5 * viscous
    elif change == "constant torque 5 N m":
        torque = torque + 5.0
    elif change == "friction 2 %":
        torque = torque + 0.02 * PUMP_DISPLACEMENT * pressure
    return flow, torque


def change_table(kind: str, answers: Sequence[Answer]) -> str:
    """Return a table in Markdown: in how many machines of a kind a change is named."""
    changes = CHANGES if kind == "transmission" else PUMP_CHANGES
    rows = []
    for change in changes:
        alike = []
        for answer in answers:
            if (answer.case.kind, answer.case.change) == (kind, change):
                alike.append(answer)
        first = sum(answer.first for answer in alike)
        in_pump = sum(answer.component == "pump" for answer in alike)
        alarms = sum(answer.verdict != "no_gap" for answer in alike)
        counts = (first, in_pump, alarms)
        rows.append((change, *(f"{count} of {len(alike)}" for count in counts)))
    return table(("change", "first in", "in the pump", "differs in"), rows)


def cases(campaigns: int, sound: int, pumps: int, seed: int) -> list[Case]:
    """Return the cases of both kinds of machine; a sound one has more seeds."""
    drawn = []
    for change in CHANGES:
        count = sound if change == NONE else campaigns
        for number in range(count):
            drawn.append(Case("transmission", change, seed + number))
    for change in PUMP_CHANGES:
        for number in range(pumps):
            drawn.append(Case("pump", change, seed + number))
    return drawn


@click.command("baseline")
@click.option("--campaigns", type=click.IntRange(0), default=4, show_default=True)
@click.option("--sound", type=click.IntRange(0), default=34, show_default=True)
@click.option("--pumps", type=click.IntRange(0), default=20, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=5, show_default=True)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
def command(campaigns: int, sound: int, pumps: int, seed: int, jobs: int) -> None:
    """Measure which change against a sound state is named."""
    with Processes(jobs) as pool:
        answers = list(pool.map(answered, cases(campaigns, sound, pumps, seed)))
    click.echo(change_table("transmission", answers))
    click.echo()
    click.echo(change_table("pump", answers))


if __name__ == "__main__":
    command()
