# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.inputs --count 300 --seed 1`: read random cycles, engine maps, vehicles."""

import argparse
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from .cycles import random_cycle
from .engines import random_engine
from .judge import judge_cycle, judge_engine, judge_vehicle
from .vehicles import random_vehicle

KINDS: dict[str, Any] = {
    "cycle": (random_cycle, judge_cycle),
    "engine": (random_engine, judge_engine),
    "vehicle": (random_vehicle, judge_vehicle),
}


def run(count: int, seed: int, show: int) -> int:
    """Read inputs of each kind; return how many were wrong without a word.

    Args:
        count: of inputs of each kind.
        seed: of the first one; input i is drawn by seed and i.
        show: wrong or refused inputs that are printed.
    """
    wrong = 0
    for kind, (draw, judge) in KINDS.items():
        refused: Counter[str] = Counter()
        shown = 0
        of_kind = 0
        for index in range(count):
            with tempfile.TemporaryDirectory() as name:
                drawn = draw(np.random.default_rng([seed, index]), Path(name))
                judged = judge(drawn)
                head = drawn.path.read_text(encoding="utf-8").splitlines()[:3]
                message = judged.refused.replace(str(drawn.path), kind)
            if judged.wrong:
                of_kind += 1
                shown += 1
                if shown <= show:
                    print(f"WRONG {index}: {judged.wrong}\n  " + "\n  ".join(head))
            elif judged.refused:
                refused[message[:90]] += 1
        wrong += of_kind
        print(
            f"{count} of kind {kind}, seed {seed}: {of_kind} wrong without a word, "
            f"{refused.total()} refused"
        )
        for message, times in refused.most_common(show):
            print(f"  {times} x {message}")
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m studies.inputs")
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", type=int, default=5)
    given = parser.parse_args()
    raise SystemExit(1 if run(given.count, given.seed, given.show) else 0)
