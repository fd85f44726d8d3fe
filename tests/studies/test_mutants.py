# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The mutants: each is one wrong edit of what an answer comes from, and of nothing else."""

import ast

from studies.mutants.mutations import mutations

SOURCE = b'''"""A docstring with 3 words."""
__all__ = ["a"]
LIMITS: dict[str, int] = {"\xc3\xb6l": 2}


@decorated(True)
def a(x: float = 0.5) -> float:
    if not x <= 1.0:
        raise ValueError(f"{x + 1} is above 1")
    x += 2
    return max(-x, x
               ** 2)
'''


def test_every_mutant_is_one_edit_that_still_parses():
    found = list(mutations("a.py", SOURCE))
    assert len({each.key for each in found}) == len(found)
    for each in found:
        changed = each.apply(SOURCE)
        assert changed != SOURCE
        ast.parse(changed)


def test_what_is_changed_and_what_is_left_alone():
    texts = {
        (SOURCE[each.start : each.end].decode(), each.text)
        for each in mutations("a.py", SOURCE)
    }
    assert {
        ("2", "3"),
        ("0.5", "1.0"),
        ("x <= 1.0", "(x < 1.0)"),
        ("x <= 1.0", "(x >= 1.0)"),
        ("not x <= 1.0", "(x <= 1.0)"),
        ("x += 2", "x -= 2"),
        ("max", "min"),
        ("-x", "(x)"),
    } <= texts
    assert not any(
        "1 is above" in old or "words" in old or old == "True" for old, _ in texts
    )
