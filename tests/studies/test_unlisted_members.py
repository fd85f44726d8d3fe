# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Listed effects that help to imitate an unlisted loss are no causes of the gap."""

import pytest

import hmcvt_core as hmcvt
from studies.blind.bench.judge import Case, draw, served
from studies.blind.bench.properties import Bench


@pytest.mark.long
def test_effects_that_imitate_an_unlisted_loss_are_not_present():
    # Microslip of a clutch: compressibility, stroke and ports imitate a third of it together.
    campaign, _ = draw(Case("unlisted", 99_900_039, Bench()))
    assert campaign.truth.names == ("clutch_microslip",)
    model, samples = served(campaign)
    diagnosis = hmcvt.diagnose(model, samples)
    assert diagnosis.verdict == "unexplained"
    assert not any(member.is_present for member in diagnosis.members)
