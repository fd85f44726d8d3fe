# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One campaign of the renewed plant, diagnosed and put to the oracle."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any
from unittest.mock import patch

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.errors import InputError
from hmcvt_core.physics.effects import library
from studies.blind.bench.classes import classes_of
from studies.blind.bench.judge import (
    ATTEMPTS,
    FRESH_TESTS,
    GROWTH,
    SAME,
    SEEDS,
    answered,
    compared,
)
from studies.blind.bench.scores import DETECTABLE
from studies.blind.renewed.campaign import (
    VERSION,
    Campaign,
    fresh_state,
    make_campaign,
    without_errors,
)
from studies.blind.renewed.look import Look, Visibility
from studies.blind.renewed.oracle import ask
from studies.blind.renewed.unlisted import Accessory

#: Errors of base and meters that a campaign can be read without.
ERRORS = ("base_errors", "meter_errors")
#: Columns that a campaign can be read without.
CHANNELS = ("output_speed", "pressure", "oil_temperature")
#: Names of the effects that the library can lack; that of a column stands for the column.
EFFECTS = tuple(sorted({kind.name for kind in library()} - set(CHANNELS)))


@dataclass(frozen=True)
class Case:
    """One campaign to diagnose.

    Attributes:
        kind: of what it hides.
        seed: of everything.
        oracle: whether the oracle is asked too.
        without: columns that are left out, `ERRORS` that are missing, and effects that the library
            is to lack.
    """

    kind: str
    seed: int
    oracle: bool = True
    without: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """A name that no other case of a run has."""
        return f"{self.kind}/{self.seed}"


@lru_cache(maxsize=8)
def draw(kind: str, seed: int) -> tuple[Campaign, Look, Visibility]:
    """Draw campaigns from the seed on; return the first whose effects can all be seen.

    Effects grow with every second attempt, so that one that hardly shows ends as well.

    Raises:
        InputError: none of the attempts is usable.
    """
    for attempt in range(ATTEMPTS):
        growth = GROWTH ** (attempt % 3)
        try:
            campaign = make_campaign(kind, SEEDS * seed + attempt // 3, growth)
        except InputError:
            continue
        look = Look(campaign)
        seen = look.visibility()
        if not seen.left or (min(seen.left) >= DETECTABLE and seen.alike < SAME):
            return campaign, look, seen
    raise InputError(f"{kind}/{seed}: no campaign of {ATTEMPTS} is usable")


def served(
    campaign: Campaign, without: Sequence[str] = ()
) -> tuple[hmcvt.EfficiencyModel, hmcvt.BenchSamples]:
    """Return all that the product receives: the served model and the bench's columns.

    Args:
        campaign: to serve.
        without: columns to leave out.
    """
    model = hmcvt.load_model(hmcvt.data_path(campaign.layout.model_file))
    columns: dict[str, Any] = {
        name: values for name, values in campaign.columns.items() if name not in without
    }
    return model, hmcvt.BenchSamples(**columns, extra=campaign.texts)


def judge(case: Case) -> dict[str, Any]:
    """Make a campaign, have it diagnosed, and return how the answer compares with the truth."""
    campaign, look, seen = draw(case.kind, case.seed)
    if not set(ERRORS).isdisjoint(case.without):
        campaign = without_errors(
            campaign,
            base="base_errors" in case.without,
            meters="meter_errors" in case.without,
        )
    model, samples = served(campaign, case.without)
    lacking = set(EFFECTS).intersection(case.without)
    known = tuple(kind for kind in library() if kind.name not in lacking)
    start = time.process_time()
    with patch("hmcvt_core.benches.transmission.system.library", return_value=known):
        found = hmcvt.diagnose(model, samples)
    seconds = time.process_time() - start
    record = {
        **_hidden(case, campaign, seen),
        **answered(found.to_dict(), campaign.layout.output_coupled),
        "seconds": seconds,
        **compared(campaign, fresh_state(campaign, FRESH_TESTS), found, model),
    }
    if case.oracle:
        record.update(ask(campaign, look).to_dict())
    return record


def _hidden(case: Case, campaign: Campaign, seen: Visibility) -> dict[str, Any]:
    """Return what a record says of the truth."""
    truth = campaign.truth
    variants = {effect.name: effect.variant for effect in truth.effects}
    classes = classes_of(list(truth.names), variants, campaign.layout.output_coupled)
    listed = {kind.name for kind in library()} & set(Accessory.listed_as)
    return {
        "version": VERSION,
        "kind": case.kind,
        "seed": case.seed,
        "layout": campaign.layout.name,
        "columns": sorted(set(campaign.columns) - set(case.without)),
        "tests": len(campaign.programme),
        "truth": list(truth.names),
        "variants": variants,
        "sizes": {effect.name: float(effect.size) for effect in truth.effects},
        "base_errors": {error.name: float(error.size) for error in truth.errors},
        "true_classes": sorted(listed) if case.kind == "accessory" else classes,
        "oracle_classes": classes,
        "left": list(seen.left),
        "sessions": int(np.max(campaign.programme.session)) + 1,
        "noise": float(np.sqrt(np.mean(campaign.noise**2))),
    }
