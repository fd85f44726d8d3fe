# SPDX-License-Identifier: Apache-2.0
"""What to do with each log of a fleet."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property

from ..errors import InputError
from ..model.model import EfficiencyModel
from ..physics.effects import effect_to_mapping
from ..physics.effects.base import Effect
from ..transmission.parameters import PAPER_PARAMETERS
from ..transmission.ranges import EFFICIENCY_STD
from ..transmission.stage import Stage
from ..version import __version__


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of `identify` and `diagnose`, the same for every log.

    Attributes:
        stages: gear trains to compare; the one with the lowest objective is kept.
        formulation: `power_balance` or `published`.
        effects: effects with fixed parameters that act besides.
        diagnosed: whether the gap is diagnosed too.
        noise: standard deviation of the efficiency [-]; None for what the log states.
        seed: of every random number.

    Raises:
        InputError: a setting is out of range, or two do not go together.
    """

    stages: tuple[Stage, ...]
    formulation: str = "power_balance"
    effects: tuple[Effect, ...] = ()
    diagnosed: bool = True
    noise: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        # Told once, before the work, not by every log.
        if not self.stages:
            raise InputError("stages is empty: at least one gear train is needed")
        for stage in self.stages:
            EfficiencyModel(stage, PAPER_PARAMETERS[0.98], self.formulation, self.effects)
        if self.diagnosed and self.formulation != "power_balance":
            raise InputError("diagnosis needs formulation power_balance, "
                             f"not {self.formulation!r}")
        if self.noise is not None:
            EFFICIENCY_STD.check(self.noise, "noise")

    @cached_property
    def sha256(self) -> str:
        """Changes with every setting and with the version of hmcvt."""
        text = json.dumps({
            "version": __version__,
            "stages": [stage.to_mapping() for stage in self.stages],
            "formulation": self.formulation,
            "effects": [effect_to_mapping(effect) for effect in self.effects],
            "diagnosed": self.diagnosed, "noise": self.noise, "seed": self.seed,
        }, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
