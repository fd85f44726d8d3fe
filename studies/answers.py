# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The head of a report for each kind of answer, on simulated campaigns.

    python -m studies.answers

Prints the sentence for the mechanic and the verdict, with what was hidden.
"""

import argparse

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis import Diagnosis
from studies.blind.bench.judge import Case, draw, served
from studies.blind.bench.properties import Bench
from studies.driver import Case as DriverCase
from studies.driver import measured

BENCH_CASES = (
    ("nothing", 41000003),
    ("single", 41000036),
    ("single", 41000041),
    ("unlisted", 99860039),
    ("single", 41000015),
    ("wrong_sign", 41000009),
)
DRIVER_CASE = DriverCase("oil temperature", "warming", True, 17)


def answers() -> list[tuple[str, Diagnosis]]:
    """Return what was hidden in each campaign, in words, and its diagnosis."""
    found = []
    for kind, seed in BENCH_CASES:
        campaign, _ = draw(Case(kind, seed, Bench()))
        model, samples = served(campaign)
        hidden = " and ".join(campaign.truth.names) or "nothing"
        if kind == "wrong_sign":
            hidden += " of the wrong sign"
        found.append((hidden.replace("_", " "), hmcvt.diagnose(model, samples)))
    samples, _, _ = measured(DRIVER_CASE)
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    hidden = "oil that warms up and is not recorded"
    found.insert(1, (hidden, hmcvt.diagnose(model, samples)))
    return found


def main() -> None:
    """Print the head of each report."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for hidden, found in answers():
        headline, verdict, *_ = found.report().split("\n\n")
        print(f"{found.verdict}; hidden: {hidden}\n")
        for line in (*headline.splitlines(), *verdict.splitlines()):
            print(f"    {line}")
        print()


if __name__ == "__main__":
    main()
