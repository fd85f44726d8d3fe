# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Messages to values of the core and back."""

import math

import numpy as np
import pytest

import hmcvt_core as hmcvt
from examples.bench_player import bench_sample_to_message
from hmcvt_ros import messages
from hmcvt_ros.inputs import Tally


def shafts(**changes):
    values = {
        "displacement_ratio": -0.5,
        "engine_speed": 100.0,
        "engine_torque": 250.0,
        "output_speed": 80.0,
        "output_torque": 250.0,
        **changes,
    }
    return bench_sample_to_message(**values)


def read(message, now):
    return messages.bench_sample_from_message(message, now, Tally(()))


def test_bench_sample_by_hand():
    # 250 N m x 100 rad/s = 25 kW in, 250 N m x 80 rad/s = 20 kW out.
    message = shafts()
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 500_000_000
    sample = read(message, now=99.0)
    assert sample.efficiency.tolist() == [0.8]
    assert sample.load_torque.tolist() == [200.0]
    assert sample.engine_speed.tolist() == [100.0]
    assert sample.displacement_ratio.tolist() == [-0.5]
    assert sample.output_speed.tolist() == [80.0]
    assert sample.stamp.tolist() == [12.5]
    assert read(shafts(), now=99.0).stamp.tolist() == [
        99.0
    ]  # without one, that of receipt


def test_joints_may_stand_in_any_order_among_others():
    message = shafts()
    for name in ("name", "position", "velocity", "effort"):
        values = list(getattr(message, name))
        extra = "wheel" if name == "name" else 1.0
        setattr(message, name, [values[2], extra, values[1], values[0]])
    assert read(message, now=1.0).efficiency.tolist() == [0.8]


def test_stroke_a_hair_beyond_one_is_taken_as_one_and_counted():
    tally = Tally(())
    sample = messages.bench_sample_from_message(
        shafts(displacement_ratio=-1.01), 1.0, tally
    )
    assert sample.displacement_ratio.tolist() == [-1.0] and tally.at_limit == 1
    with pytest.raises(
        hmcvt.InputError, match=r"displacement_ratio = 1\.021 is outside"
    ):
        messages.bench_sample_from_message(shafts(displacement_ratio=1.021), 1.0, tally)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"engine_speed": 1000.0}, "r/min"),
        ({"engine_speed": 0.0}, "must be positive"),
        ({"engine_speed": math.nan}, "must be positive"),
        ({"engine_torque": -250.0}, "must be positive"),
        ({"engine_torque": math.inf}, "efficiency"),
        ({"output_torque": 400.0}, "efficiency = 1.28 is outside"),
        ({"output_torque": -250.0}, "load_torque"),
        ({"output_speed": math.nan}, "load_torque"),
        ({"displacement_ratio": 50.0}, "displacement_ratio"),
    ],
)
def test_bad_sample_is_refused_with_the_reason(changes, word):
    with pytest.raises(hmcvt.InputError, match=r"^bench_sample") as caught:
        read(shafts(**changes), now=1.0)
    assert word in str(caught.value)


@pytest.mark.parametrize(
    ("field", "value", "word"),
    [
        ("name", ["engine", "output"], "'displacement' stands 0 times"),
        ("name", ["engine", "engine", "displacement"], "'engine' stands 2 times"),
        ("name", [], "stands 0 times"),
        ("velocity", [], "velocity has 0 values for 3 joints"),
        ("effort", [1.0], "effort has 1 values"),
        ("position", [], "position has 0 values"),
    ],
)
def test_malformed_joint_state_is_refused(field, value, word):
    message = shafts()
    setattr(message, field, value)
    with pytest.raises(hmcvt.InputError, match=word):
        read(message, now=1.0)


def test_map_is_laid_out_as_documented(paper_file):
    model = hmcvt.load_model(paper_file)
    grid = model.efficiency_map(
        [-1.0, 0.0, 1.0], [80.0, 200.0], [50.0, 100.0, 200.0, 400.0]
    )
    message = messages.map_to_message(grid)
    assert [(d.label, d.size, d.stride) for d in message.layout.dim] == [
        ("displacement_ratio", 3, 24),
        ("engine_speed", 2, 8),
        ("load_torque", 4, 4),
    ]
    assert message.layout.data_offset == 9
    # The documented way to one value, by hand: (i, j, k) = (2, 1, 3).
    assert message.data[9 + 2 * 8 + 1 * 4 + 3] == grid.efficiency[2, 1, 3]
    np.testing.assert_array_equal(
        message.data,
        np.concatenate(
            [
                grid.displacement_ratio,
                grid.engine_speed,
                grid.load_torque,
                grid.efficiency.ravel(),
            ]
        ),
    )
