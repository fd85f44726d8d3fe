# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""An effect that is defined twice, as when a cell of a notebook is run again."""

import gc

from hmcvt_core.physics.effects import effect_from_mapping, effect_to_mapping, library

CELL = '''
from dataclasses import dataclass
from hmcvt_core import Effect, size

@dataclass(frozen=True)
class Rubbing(Effect):
    """Rubs."""
    name = "test_rubbing"
    component = "gears"
    torque: float = size("N m", 1.0, 0.0, {most}, "torque")
'''


def test_the_later_definition_replaces_the_earlier_one():
    notebook = {"__name__": "__main__"}
    exec(CELL.format(most=10.0), notebook)
    first = notebook["Rubbing"]
    exec(CELL.format(most=20.0), notebook)
    again = notebook["Rubbing"]
    assert [kind for kind in library() if kind.name == "test_rubbing"] == [again]
    saved = effect_to_mapping(first(5.0))
    assert type(effect_from_mapping(saved, "effect")) is again
    del notebook, first, again
    gc.collect()  # its class must not reach other tests
