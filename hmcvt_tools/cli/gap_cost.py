# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt diagnose --mission`: what a gap costs on a work cycle, in fuel."""

from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.files import data_path
from hmcvt_core.model.engine import load_engine
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.parameter_file import load_model

from ..mission import Cycle, Drive, load_vehicle, read_cycle
from ..mission.knowledge import in_transmission, worth
from ..mission.result import DIESEL_DENSITY
from .common import Answer

_SHOWN = 0.0005
"""Saving that three decimals show [l/h]."""
_NO_CAUSE = "no cause is added to the model: there is nothing to price on the cycle"


def cycle_from(name: str) -> Cycle:
    """Read a cycle for the shipped vehicle; see `read_cycle`."""
    return read_cycle(name, load_vehicle(data_path("params/vehicle.yaml")))


def with_gap_cost(
    answer: Answer, diagnosis: Diagnosis, model: EfficiencyModel, cycle: Cycle
) -> Answer:
    """Return the answer of a diagnosis with what the gap costs on a cycle.

    The tractor is the diagnosed model, with the shipped engine and vehicle. A model of one stage
    that the shipped transmission has drives all stages of that one.

    Args:
        answer: of the diagnosis.
        diagnosis: with the cause, and the base model refitted without it.
        model: as given; the strategy without the knowledge has it.
        cycle: demand.

    Raises:
        InputError: the model is of another formulation than `power_balance`.
    """
    if diagnosis.model is diagnosis.base:
        return answer._replace(
            value={**answer.value, "mission": None}, lines=[*answer.lines, _NO_CAUSE]
        )
    tractor = load_model(data_path("params/tractor.yaml"))
    truth = in_transmission(diagnosis.model, tractor)
    drive = Drive(
        truth,
        load_engine(data_path("params/engine.yaml")),
        load_vehicle(data_path("params/vehicle.yaml")),
    )
    given = worth(drive, in_transmission(model, tractor), cycle)
    refitted = worth(drive, in_transmission(diagnosis.base, tractor), cycle)
    by_refit = given.saving - refitted.saving
    value = {**given.to_dict(), "saving_by_refit": by_refit}
    beyond = refitted.saving / DIESEL_DENSITY
    line = "Knowing the cause saves no more than a refit without it."
    if beyond >= _SHOWN:
        line = f"Knowing the cause saves {beyond:.3f} l/h beyond a refit without it."
    return answer._replace(
        value={**answer.value, "mission": value},
        lines=[*answer.lines, given.report(), line],
    )
