# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Reports of simulated campaigns, read by rules: does a report contradict itself?

python -m studies.consistency --campaigns 200 --seed 96000000
"""

import argparse
import re
from collections import Counter
from collections.abc import Callable

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.settings import REGION_SIGNIFICANCE
from hmcvt_core.errors import InputError
from hmcvt_tools.fleet.executors import Processes
from studies.blind.bench.judge import Case, draw, served
from studies.blind.bench.library import without_effects
from studies.blind.bench.properties import Bench
from studies.blind.bench.study import cases

NAMED = ("cause_found", "class_found", "other_form", "ambiguous")


def _headline(found: Diagnosis) -> str:
    return found.report().split("\n\n")[0]


def _is_told_and_denied(found: Diagnosis) -> bool:
    """Whether a region is referred to and there is none."""
    text = " ".join(found.report().split())
    speaks_of_regions = "look at the regions" in text or "region stands out" in text
    return speaks_of_regions and not found.where


def _costs_without_a_cause(found: Diagnosis) -> bool:
    return found.named is None and re.search(r"\d W\b", _headline(found)) is not None


def _names_nothing(found: Diagnosis) -> bool:
    return found.verdict in NAMED and not (found.causes and found.sets)


def _is_certain_and_open(found: Diagnosis) -> bool:
    """Whether a found cause is called uncertain in the first sentence."""
    is_found = found.verdict in ("cause_found", "class_found")
    return is_found and _headline(found).startswith("Perhaps")


def _repeats_a_test(found: Diagnosis) -> bool:
    tests = [
        (tuple((test.point or {}).items()), tuple(test.setting.items()), test.measure)
        for test in found.next_tests
    ]
    return len(set(tests)) < len(tests)


def _asks_for_a_test_without_gain(found: Diagnosis) -> bool:
    return any(test.point and round(test.gain, 1) == 0.0 for test in found.next_tests)


def _prints_an_empty_region(found: Diagnosis) -> bool:
    channel = found.channel
    for region in found.where:
        size = abs(channel.factor * region.mean_residual)
        if region.p_value > REGION_SIGNIFICANCE or round(size, channel.digits) == 0.0:
            return True
    return False


def _delivers_something_worse(found: Diagnosis) -> bool:
    return found.delivered.rmse_after > found.delivered.rmse_before


def _promises_for_another_model(found: Diagnosis) -> bool:
    keeps_base = found.delivered.kind == "base"
    return keeps_base and found.shrinkage.fraction not in (None, 0.0)


def _agrees_and_scatters(found: Diagnosis) -> bool:
    return found.verdict == "no_gap" and not found.agreement.holds


RULES: dict[str, Callable[[Diagnosis], bool]] = {
    "a region is referred to, and none is printed": _is_told_and_denied,
    "watts in the headline without a cause": _costs_without_a_cause,
    "a cause is found, and none is named": _names_nothing,
    "a found cause is called uncertain": _is_certain_and_open,
    "a next test is listed twice": _repeats_a_test,
    "a next test has no gain": _asks_for_a_test_without_gain,
    "a region is not significant, or of no size": _prints_an_empty_region,
    "the saved model is worse": _delivers_something_worse,
    "the base is saved, and the gap shrinks": _promises_for_another_model,
    "no gap above the stated noise": _agrees_and_scatters,
}
"""What no report may do."""


def contradictions(found: Diagnosis) -> list[str]:
    """Return the rules that a report breaks."""
    return [rule for rule, breaks in RULES.items() if breaks(found)]


def read(case: Case) -> tuple[str, str, list[str]]:
    """Return a campaign, its verdict, and the rules that its report breaks."""
    try:
        campaign, _ = draw(case)
    except InputError:
        return case.key, "not drawn", []
    model, samples = served(campaign)
    hidden = campaign.truth.effects if case.kind == "unlisted" else ()
    with without_effects(hidden):
        found = hmcvt.diagnose(model, samples)
    return case.key, found.verdict, contradictions(found)


def main() -> None:
    """Print how many reports break which rule."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    with Processes(options.jobs) as pool:
        futures = [
            pool.submit(read, case)
            for case in cases(options.campaigns, options.seed, Bench())
        ]
        results = [future.result() for future in futures]
    verdicts = Counter(verdict for _, verdict, _ in results)
    print(f"{len(results)} reports: {dict(verdicts)}")
    for rule in RULES:
        broken = [key for key, _, rules in results if rule in rules]
        print(f"{len(broken):4d}  {rule}  {' '.join(broken[:5])}")


if __name__ == "__main__":
    main()
