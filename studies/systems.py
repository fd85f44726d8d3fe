# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.systems`: withheld causes of machines that are no transmission.

Three simulators of `examples/` (a fan, an electric drive, a robot joint in MuJoCo) hide one effect
that their library lists, or one that it does not list. The diagnosis reads points and readings
alone. A listed effect counts as named where the leading set is that effect and the verdict names
it; an unlisted one as refused where no listed cause is named as the whole explanation.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis.results.outcome import NAMING
from hmcvt_core.files.atomic import write_atomically
from studies.page import Goal, goal_table, render, table
from studies.workers import Record

EXAMPLES = Path(__file__).parents[1] / "examples"
GOAL = 0.8
"""Fraction of campaigns that have to be right, of listed and of unlisted causes."""
SIZES = (0.5, 2.0)
"""Least and largest size of a hidden effect, in typical sizes of the library."""
LISTED = "listed"
UNLISTED = "unlisted"

Readings = Mapping[str, hmcvt.Array]
Distortion = Callable[[Readings, Readings, np.random.Generator], Readings]
"""Function of points, readings and a generator that returns readings with an unlisted loss."""


@dataclass(frozen=True)
class Machine:
    """A simulator and how campaigns of it are made.

    Attributes:
        title: for the page.
        module: of `examples/`.
        system: name of the `Simulator` in it.
        noise: name of the standard deviations of the channels in it.
        needs: package without which it cannot run.
        unlisted: losses that its library does not list, by name.
    """

    title: str
    module: str
    system: str
    noise: str
    needs: str
    unlisted: Mapping[str, Distortion]


def _band(values: hmcvt.Array, centre: float, width: float) -> hmcvt.Array:
    """Return a bell of height 1."""
    return np.asarray(np.exp(-0.5 * ((values - centre) / width) ** 2))


def _fan_stall(points: Readings, read: Readings, rng: np.random.Generator) -> Readings:
    """Blades stall around a flow per speed."""
    coefficient = points["flow"] / points["speed"]
    centre = rng.uniform(*np.quantile(coefficient, (0.3, 0.7)))
    depth = rng.uniform(0.02, 0.06)
    bell = _band(coefficient, centre, 0.15 * centre)
    return {**read, "efficiency": read["efficiency"] - depth * bell}


def _fan_resonance(
    points: Readings, read: Readings, rng: np.random.Generator
) -> Readings:
    """The casing resonates around a speed."""
    depth = rng.uniform(0.02, 0.06)
    bell = _band(points["speed"], rng.uniform(90.0, 170.0), 12.0)
    return {**read, "efficiency": read["efficiency"] - depth * bell}


def _drive_resonance(
    points: Readings, read: Readings, rng: np.random.Generator
) -> Readings:
    """Stray flux heats the casing around a speed."""
    loss = rng.uniform(100.0, 300.0)
    bell = _band(points["speed"], rng.uniform(150.0, 500.0), 40.0)
    return {**read, "battery_power": read["battery_power"] + loss * bell}


def _drive_saturation(
    points: Readings, read: Readings, rng: np.random.Generator
) -> Readings:
    """Iron saturates above a torque: more current for it."""
    knee = rng.uniform(40.0, 60.0)
    excess = np.maximum(points["torque"] - knee, 0.0)
    part = rng.uniform(0.002, 0.006) * excess
    return {**read, "phase_current": read["phase_current"] * (1.0 + part)}


def _joint_resonance(
    points: Readings, read: Readings, rng: np.random.Generator
) -> Readings:
    """The frame swings along around a frequency and takes power."""
    torque = rng.uniform(0.3, 1.0)
    bell = _band(points["frequency"], rng.uniform(1.5, 2.2), 0.12)
    return {**read, "torque_speed": read["torque_speed"] + torque * bell}


def _joint_cable(
    points: Readings, read: Readings, rng: np.random.Generator
) -> Readings:
    """A cable stretches beyond an angle and pulls back."""
    slack = rng.uniform(0.25, 0.4)
    excess = np.maximum(points["amplitude"] - slack, 0.0)
    torque = rng.uniform(3.0, 10.0) * excess
    return {**read, "torque_position": read["torque_position"] + torque}


MACHINES = {
    "fan": Machine(
        "fan",
        "own_system",
        "Fan",
        "NOISE",
        "numpy",
        {"stall": _fan_stall, "resonance": _fan_resonance},
    ),
    "drive": Machine(
        "electric drive",
        "electric_drive",
        "system",
        "CHANNEL_NOISE",
        "numpy",
        {"resonance": _drive_resonance, "saturation": _drive_saturation},
    ),
    "joint": Machine(
        "robot joint in MuJoCo",
        "mujoco_joint",
        "JOINT",
        "NOISE",
        "mujoco",
        {"resonance": _joint_resonance, "cable": _joint_cable},
    ),
}


def loaded(machine: Machine) -> tuple[Any, Any, Mapping[str, float]]:
    """Return the example, its system, and the noise of its channels."""
    if str(EXAMPLES) not in sys.path:
        sys.path.insert(0, str(EXAMPLES))
    module = importlib.import_module(machine.module)
    system = getattr(module, machine.system)
    if isinstance(system, type):
        system = system()
    return module, system, getattr(module, machine.noise)


def trial(name: str, kind: str, seed: int) -> Record:
    """Hide a cause in a campaign, diagnose it, and return what was hidden and what was said.

    Args:
        name: of the machine.
        kind: `listed` or `unlisted`.
        seed: of the cause, which takes turns, its size and the campaign.
    """
    machine = MACHINES[name]
    module, system, noise = loaded(machine)
    rng = np.random.default_rng([seed, 61])
    if kind == LISTED:
        effect = system.library[seed % len(system.library)]
        size = effect.sizes()[0]
        hidden = effect.name
        value = size.typical * float(np.exp(rng.uniform(*np.log(SIZES))))
        points, readings = module.campaign(seed, **{hidden: value})
    else:
        hidden = sorted(machine.unlisted)[seed % len(machine.unlisted)]
        points, readings = module.campaign(seed)
        readings = machine.unlisted[hidden](points, readings, rng)
    observed = hmcvt.observe_system(system, {**points, **readings}, noise=noise)
    diagnosis = hmcvt.diagnose_system(system, observed)
    leading = diagnosis.sets[0] if diagnosis.sets else None
    return {
        "machine": name,
        "kind": kind,
        "seed": seed,
        "hidden": hidden,
        "verdict": diagnosis.verdict,
        "leading": list(leading.effects) if leading else [],
        "probability": leading.probability if leading else 0.0,
        "right": is_right(kind, hidden, diagnosis),
    }


def is_right(kind: str, hidden: str, diagnosis: Any) -> bool:
    """Return whether a listed cause is named alone, or an unlisted one refused."""
    names = diagnosis.verdict in NAMING
    if kind == LISTED:
        return names and diagnosis.sets[0].effects == (hidden,)
    # `other_form` says that the listed forms do not suffice: the explanation is refused.
    return not names or diagnosis.verdict == "other_form"


def _goals(title: str, records: list[Record]) -> list[Goal]:
    """Return the goals of listed and of unlisted causes for some campaigns."""
    goals = []
    for kind, word in ((LISTED, "named"), (UNLISTED, "refused")):
        of_kind = [record["right"] for record in records if record["kind"] == kind]
        right = sum(of_kind)
        goals.append(
            Goal(
                f"{title}, {kind} cause {word}",
                f">= {100.0 * GOAL:.0f} %",
                f"{right} of {len(of_kind)}",
                right >= GOAL * len(of_kind),
            )
        )
    return goals


@click.command("systems")
@click.argument("machines", nargs=-1, type=click.Choice(list(MACHINES)))
@click.option("--campaigns", default=30, show_default=True, help="Of each kind.")
@click.option("--first-seed", default=61_000_000, show_default=True)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=None)
def command(
    machines: tuple[str, ...], campaigns: int, first_seed: int, out: Path | None
) -> None:
    """Hide causes in campaigns of each machine and count right answers."""
    records = []
    for name in machines or MACHINES:
        if importlib.util.find_spec(MACHINES[name].needs) is None:
            click.echo(
                f"{name} left out: it needs {MACHINES[name].needs}, pip install "
                f"{MACHINES[name].needs}",
                err=True,
            )
            continue
        for kind in (LISTED, UNLISTED):
            for i in range(campaigns):
                records.append(trial(name, kind, first_seed + i))
                click.echo(str(records[-1]), err=True)
    page = written(records, campaigns, first_seed)
    click.echo(page)
    if out is not None:
        write_atomically(out, page)


def written(records: list[Record], campaigns: int, first_seed: int) -> str:
    """Return the page of the study."""
    goals = []
    for name in dict.fromkeys(record["machine"] for record in records):
        of_machine = [record for record in records if record["machine"] == name]
        goals += _goals(MACHINES[name].title, of_machine)
    goals += _goals("all machines", records)
    wrong = []
    for record in records:
        if not record["right"]:
            said = " + ".join(record["leading"]) or "-"
            wrong.append(
                (
                    MACHINES[record["machine"]].title,
                    record["seed"],
                    f"{record['hidden']} ({record['kind']})".replace("_", " "),
                    record["verdict"].replace("_", " "),
                    f"{said} ({100.0 * record['probability']:.0f} %)".replace("_", " "),
                )
            )
    head = ("machine", "seed", "hidden", "verdict", "leading set")
    return render(
        "systems.md.j2",
        Path(__file__).parent,
        goals=goal_table(goals),
        wrong=table(head, wrong) if wrong else "None.",
        campaigns=campaigns,
        first_seed=first_seed,
    )


if __name__ == "__main__":
    command()
