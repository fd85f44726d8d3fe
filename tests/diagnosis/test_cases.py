# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Cases that are predicted together have the predictions that they have alone."""

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission
from hmcvt_core.diagnosis.system import predict_cases
from tests.diagnosis.campaigns import random_points


@pytest.mark.parametrize("file", ["hm4", "output_coupled"])
def test_cases_are_predicted_as_alone(file):
    model = hmcvt.load_model(hmcvt.data_path(f"params/{file}.yaml"))
    system = Transmission(model, ["pressure"])
    points = random_points(3, n=12, temperature=True)._asdict()
    points.pop("stage")
    cases = []
    for i, effect in enumerate(system.library):
        size = effect.sizes()[0]
        base = system.base.mean.copy()
        base[i % len(base)] += 0.01
        cases.append((base, (effect.with_values({size.name: 0.1 * size.typical}),)))
    alone = np.stack([system.predict(*case, points) for case in cases])
    together = predict_cases(system, cases, points)
    np.testing.assert_array_equal(np.isnan(together), np.isnan(alone))
    np.testing.assert_allclose(together, alone, rtol=1e-7)
