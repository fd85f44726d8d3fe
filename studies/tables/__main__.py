# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.tables --count 20000 --seed 1`: import random tables."""

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from .judge import judge
from .truth import random_table


def run(count: int, seed: int, show: int) -> int:
    """Import tables; return how many were wrong without a word.

    Args:
        count: of tables.
        seed: of the first one; table i is drawn by seed + i.
        show: wrong or asked tables that are printed.
    """
    wrong = 0
    taken = 0
    complete = 0
    asked: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        for index in range(count):
            table = random_table(np.random.default_rng([seed, index]))
            outcome = judge(table, Path(name))
            complete += table.complete
            taken += table.complete and outcome.code == 0
            if outcome.wrong:
                wrong += 1
                if wrong <= show:
                    print(f"WRONG {index}: {outcome.wrong}: {table.features}")
                    print("\n".join(table.text.splitlines()[:4]))
            elif outcome.code != 0 and table.complete:
                asked[outcome.message.partition("table.csv: ")[2][:60]] += 1
                if sum(asked.values()) <= show:
                    print(
                        f"ASKED {index}: {outcome.message[-300:]}\n  {table.features}"
                    )
    share = 100.0 * taken / max(complete, 1)
    print(f"{count} tables, seed {seed}: {wrong} wrong without a word")
    print(
        f"{complete} complete, of which {taken} ({share:.1f} %) imported without a question"
    )
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m studies.tables")
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--show", type=int, default=5)
    given = parser.parse_args()
    raise SystemExit(1 if run(given.count, given.seed, given.show) else 0)
