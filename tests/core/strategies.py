# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random valid stages, parameters and operating points."""

import itertools

from hypothesis import strategies as st

from hmcvt_core import GearPair, HydraulicParameters, Path, PumpMotor, Stage
from hmcvt_core.transmission.stage import MEMBERS, member_speed_coefficients

signs = st.sampled_from((-1, 1))
displacements = st.floats(-6.0, -4.5).map(lambda exponent: 10.0**exponent)


def pairs(name):
    """One to three gear pairs; names are unique within a stage."""
    pair = st.tuples(st.floats(0.5, 2.5), st.floats(0.9, 0.995))
    return st.lists(pair, min_size=1, max_size=3).map(
        lambda found: tuple(
            GearPair(f"{name}{i}", *values) for i, values in enumerate(found)
        )
    )


@st.composite
def stages(draw):
    """Any arrangement of the members whose mechanical path drives the output forward."""
    mechanical, motor, output = draw(
        st.sampled_from(list(itertools.permutations(MEMBERS)))
    )
    k = draw(st.floats(1.2, 5.0))
    row = member_speed_coefficients(k)
    sense = draw(signs)
    forward = sense if row[mechanical] * row[output] < 0.0 else -sense
    return Stage(
        "random",
        k,
        Path(draw(pairs("m")), forward),
        mechanical,
        Path(draw(pairs("p"))),
        Path(draw(pairs("h")), draw(signs)),
        motor,
        Path(draw(pairs("o")), sense),
        output,
        PumpMotor(
            draw(displacements),
            draw(displacements),
            draw(st.floats(0.0, 0.1)),
            draw(st.floats(0.0, 0.1)),
        ),
    )


parameters = st.builds(
    HydraulicParameters,
    st.floats(-13.0, -10.0).map(lambda exponent: 10.0**exponent),
    st.floats(0.0, 1.0),
    st.floats(1e-3, 1.0),
)
moderate = st.builds(
    HydraulicParameters,
    st.floats(1e-13, 3e-11),
    st.floats(0.0, 0.3),
    st.floats(0.0, 0.5),
)
engine_speeds = st.floats(20.0, 300.0)
load_torques = st.floats(1.0, 3.0).map(lambda exponent: 10.0**exponent)
strokes = st.floats(-1.0, 1.0)
