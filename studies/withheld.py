# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Find a withheld cause live: seal it, diagnose, open the seal (second half of `make demo`).

    python -m studies.withheld [--seed N] [--out FOLDER]

A plant whose physics are written apart from the served model hides one effect. What is hidden
is written to a file whose SHA-256 is printed before the diagnosis, which reads the bench file
alone. Then the seal is opened, and the shrinkage is measured on fresh tests of the plant. The
answer may be wrong, and is then shown as wrong.
"""

import argparse
import hashlib
import json
import secrets
import sys
import textwrap
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

import hmcvt_core as hmcvt
from studies.blind.bench.campaign import Campaign, fresh_state
from studies.blind.bench.classes import class_of
from studies.blind.bench.confusion import Confusion
from studies.blind.bench.judge import Case, draw, predicted, served, true_efficiency
from studies.blind.bench.properties import Bench
from studies.blind.catalogue import KNOWN_EFFECTS
from studies.blind.effect import FloatArray

matplotlib.use("Agg")
from matplotlib import pyplot as plt

MODEL_FILE = "params/hm4.yaml"
BENCH = Bench().without("layouts")
"""One stage, with the errors of real meters, several sessions and oil that warms up."""
MIN_BEYOND = 50.0
"""Squared deviations that no other listed effect imitates, by the plant's own physics.

Below it the readings hardly say which effect it is, whatever reads them. The rule is the same for
every seed and does not ask the diagnosis.
"""
FRESH_TESTS = 200
LARGEST_SEED = 1_000_000
_DRAWS = 40
_SHOWN_SETS = 5
_LABEL_WIDTH = 24
_BLUE = "#1f5f99"
_ORANGE = "#b3480a"
_GREY = "#8a939c"


@dataclass(frozen=True)
class Fresh:
    """Fresh tests of the plant, without the errors of meters; arrays of shape (n,).

    Attributes:
        points: operating points by axis [SI].
        before: true efficiency - refitted base model [-].
        after: true efficiency - model with the diagnosed effects [-].
        reported: gap that the diagnosis predicts there [-].
    """

    points: dict[str, FloatArray]
    before: FloatArray
    after: FloatArray
    reported: FloatArray

    @property
    def removed(self) -> float:
        """Fraction of the squared gap that the model with the effects removes."""
        return 1.0 - float(np.mean(self.after**2) / np.mean(self.before**2))


def draw_campaign(seed: int) -> tuple[Campaign, Confusion]:
    """Return the first campaign of a seed whose cause can be told in principle."""
    for number in range(_DRAWS):
        campaign, confusion = draw(Case("single", _DRAWS * seed + number, BENCH))
        (effect,) = campaign.truth.effects
        has_class = class_of(effect.name, effect.variant, False) != effect.name
        if not has_class and (confusion.beyond or 0.0) >= MIN_BEYOND:
            return campaign, confusion
    raise RuntimeError(f"seed {seed}: no campaign has a cause that can be told")


def seal(campaign: Campaign, folder: Path, seed: int) -> str:
    """Write the bench file and the sealed truth; return the SHA-256 of the truth."""
    _, samples = served(campaign)
    hmcvt.write_bench(folder / "bench.csv", samples)
    (effect,) = campaign.truth.effects
    truth = {
        "seed": seed,
        "effect": effect.name,
        "shape": asdict(effect),
        "base": asdict(campaign.truth.plain.base),
        # Without it, the few effects there are could be tried against the hash.
        "salt": secrets.token_hex(16),
    }
    text = json.dumps(truth, indent=1) + "\n"
    (folder / "truth.json").write_text(text, encoding="utf-8")
    return digest(folder / "truth.json")


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def diagnosed(folder: Path) -> hmcvt.Diagnosis:
    """Diagnose the bench file of a folder; nothing else of the campaign is read."""
    model = hmcvt.load_model(hmcvt.data_path(MODEL_FILE))
    return hmcvt.diagnose(model, hmcvt.read_bench(folder / "bench.csv"))


def judged(
    verdict: str, sets: Sequence[tuple[tuple[str, ...], float]], hidden: str
) -> str:
    """Return how an answer compares with the hidden effect, in a plain sentence.

    Args:
        verdict: of the diagnosis.
        sets: effects of each set and its probability, most probable first.
        hidden: name of the effect.
    """
    name = hidden.replace("_", " ")
    if verdict == "no_gap":
        return f"MISSED: the diagnosis saw no gap; {name} was hidden."
    if verdict in ("unexplained", "excess_scatter") or not sets:
        return f"NOT NAMED: {name} was hidden; the verdict is `{verdict}`."
    leading, probability = sets[0]
    leading_text = " + ".join(leading).replace("_", " ")
    if leading == (hidden,) and verdict != "ambiguous":
        return f"RIGHT: {name} was hidden, and is named."
    if leading == (hidden,):
        return (
            f"LEADING, NOT SETTLED: {name} was hidden and leads with "
            f"{100 * probability:.0f} %; the verdict is `{verdict}`."
        )
    ranks = [rank for rank, (effects, _) in enumerate(sets, 1) if effects == (hidden,)]
    rank = f"rank {ranks[0]}" if ranks else "no rank"
    if hidden in leading:
        return (
            f"PARTLY RIGHT: {name} alone was hidden, but {leading_text} leads. Alone it has "
            f"{rank} among the sets."
        )
    return f"WRONG: {name} was hidden, but {leading_text} leads. The truth has {rank}."


def fresh_tests(campaign: Campaign, found: hmcvt.Diagnosis) -> Fresh:
    """Return the plant at operating points that the diagnosis has not seen."""
    programme, settings, state = fresh_state(campaign, FRESH_TESTS)
    efficiency, points = true_efficiency(campaign, settings, state)
    names = [campaign.layout.trains[number].name for number in programme.stage]
    before = efficiency - predicted(found.base, points, names)
    after = efficiency - predicted(found.model, points, names)
    reported, _ = found.gap_at(**points)
    usable = np.isfinite(before) & np.isfinite(after) & np.isfinite(reported)
    kept = {axis: values[usable] for axis, values in points.items()}
    return Fresh(kept, before[usable], after[usable], reported[usable])


def draw_picture(found: hmcvt.Diagnosis, fresh: Fresh, hidden: str, path: Path) -> None:
    """Draw where the gap lies, which effect it is and how far it shrinks."""
    figure, axes = plt.subplots(2, 2, figsize=(12.5, 8.6), layout="constrained")
    largest = 100.0 * float(np.max(np.abs(fresh.before)))
    for axis, values, title in (
        (axes[0, 0], fresh.before, "Where: true gap at fresh tests"),
        (axes[0, 1], fresh.reported, "Where: gap that the diagnosis reports"),
    ):
        marks = axis.scatter(
            fresh.points["displacement_ratio"],
            fresh.points["engine_speed"],
            c=100.0 * values,
            cmap="RdBu",
            vmin=-largest,
            vmax=largest,
            edgecolors=_GREY,
            linewidths=0.5,
        )
        axis.set(title=title, xlabel="displacement ratio [-]")
        axis.set_ylabel("engine speed [rad/s]")
    figure.colorbar(marks, ax=axes[0, :], label="plant - base model [points]")
    _draw_sets(axes[1, 0], found, hidden)
    _draw_shrinkage(axes[1, 1], fresh)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _draw_sets(axis: Any, found: hmcvt.Diagnosis, hidden: str) -> None:
    """Draw the most probable sets; the true one is filled."""
    sets = found.sets[:_SHOWN_SETS]
    names = [
        textwrap.fill(" + ".join(item.effects).replace("_", " "), _LABEL_WIDTH)
        for item in sets
    ]
    shares = [100.0 * item.probability for item in sets]
    colours = [_ORANGE if item.effects == (hidden,) else _GREY for item in sets]
    names.append("something unlisted")
    shares.append(100.0 * found.unlisted)
    colours.append("white")
    bars = axis.barh(names, shares, color=colours, edgecolor=_GREY)
    axis.bar_label(bars, fmt="%.0f %%", padding=3)
    axis.invert_yaxis()
    axis.set(xlim=(0.0, 115.0), xlabel="probability [%]")
    axis.set_title(f"Which: {hidden.replace('_', ' ')} was hidden (orange)")


def _draw_shrinkage(axis: Any, fresh: Fresh) -> None:
    order = np.argsort(fresh.before)
    number = np.arange(1, len(order) + 1)
    for values, colour, mark, label in (
        (fresh.before, _BLUE, "o", "base model"),
        (fresh.after, _ORANGE, "x", "with the diagnosed effects"),
    ):
        rms = 100.0 * np.sqrt(np.mean(values**2))
        text = f"{label}: {rms:.2f} points rms"
        axis.plot(number, 100.0 * values[order], mark, ms=4, color=colour, label=text)
    axis.axhline(0.0, color=_GREY, linewidth=0.8)
    axis.set(xlabel="fresh test, in order of its gap", ylabel="plant - model [points]")
    axis.set_title(f"How far: {100 * fresh.removed:.1f} % of the squared gap removed")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), frameon=False)


def story(seed: int, folder: Path, by_chance: bool) -> None:
    """Tell the whole trial in print."""
    folder.mkdir(parents=True, exist_ok=True)
    print(
        f"""
A cause that is withheld

1. A plant whose equations are written apart from those of hmcvt (studies/blind) draws one of
   {len(KNOWN_EFFECTS)} effects. Its bench has torque meters with zeros, gains and drift, several
   sessions, and oil that warms up."""
    )
    campaign, _ = draw_campaign(seed)
    sealed = seal(campaign, folder, seed)
    print(
        f"""
     tests      {folder / "bench.csv"} ({len(campaign.programme)} tests)
     sealed     {folder / "truth.json"}
     SHA-256    {sealed}

2. hmcvt.diagnose reads {MODEL_FILE} and the tests, and nothing else:
"""
    )
    start = time.perf_counter()
    found = diagnosed(folder)
    seconds = time.perf_counter() - start
    for paragraph in found.report().split("\n\n")[:2]:
        for line in paragraph.splitlines():
            print(f"     {line}")
        print()
    print(f"   {seconds:.1f} s.")
    if digest(folder / "truth.json") != sealed:
        raise RuntimeError(f"{folder / 'truth.json'} has changed since it was sealed")
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    hidden = truth["effect"]
    sets = [(item.effects, item.probability) for item in found.sets]
    form = truth["shape"]["variant"].replace("_", " ")
    of_form = f" ({form})" if form else ""
    print(
        f"""
3. The seal is opened; the SHA-256 is the same.

     hidden     {hidden.replace("_", " ")}{of_form}
     answer     {judged(found.verdict, sets, hidden)}
"""
    )
    fresh = fresh_tests(campaign, found)
    before, after = (
        100.0 * float(np.sqrt(np.mean(values**2)))
        for values in (fresh.before, fresh.after)
    )
    remark = ""
    if found.delivered.kind == "base":
        remark = (
            "\n     The diagnosis serves none of these effects: it kept the base model."
        )
    elif fresh.removed < 0.0:
        remark = "\n     The model with the effects is WORSE than the base model there."
    print(
        f"""4. {len(fresh.before)} fresh tests of the plant, by meters without errors:

     plant - model    {before:.2f} -> {after:.2f} points rms
     squared gap      {100 * fresh.removed:.1f} % removed, {_predicted(found)}.{remark}
"""
    )
    picture = folder / "withheld.png"
    draw_picture(found, fresh, hidden, picture)
    again = f"`make demo SEED={seed}` repeats it"
    drawn = f"The seed {seed} was drawn; {again}." if by_chance else f"Seed {seed}."
    print(f"   Picture: {picture}\n   {drawn}\n")


def _predicted(found: hmcvt.Diagnosis) -> str:
    """Return what the diagnosis said of the shrinkage before the seal was opened."""
    shrinkage = found.shrinkage
    if shrinkage.fraction is None:
        return "nothing predicted"
    text = f"{100 * shrinkage.fraction:.1f} % predicted"
    if shrinkage.interval is None:
        return text
    low, high = shrinkage.interval
    return f"{text} (95 %: {100 * low:.0f} to {100 * high:.0f} %)"


def main() -> None:
    """Run one trial."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.withheld", description="Find a withheld cause."
    )
    parser.add_argument("--seed", type=int, help="0 to 999999; drawn where left out")
    parser.add_argument("--out", type=Path, default=Path("build/demo"))
    options = parser.parse_args()
    seed = options.seed
    if seed is None:
        seed = secrets.randbelow(LARGEST_SEED)
    if not 0 <= seed < LARGEST_SEED:
        parser.error(f"--seed {seed}: must be 0 to {LARGEST_SEED - 1}")
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    story(seed, options.out, options.seed is None)


if __name__ == "__main__":
    main()
