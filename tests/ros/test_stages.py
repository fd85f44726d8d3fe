# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A model of several stages in the node: the stage changes while it runs, the engine is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from ros_bench import GOOD
from sensor_msgs.msg import JointState
from std_msgs.msg import String

import hmcvt_core as hmcvt
from examples.bench_player import bench_sample_to_message
from hmcvt_ros import qos
from hmcvt_ros.bench_log import BenchLog, rows_of
from hmcvt_ros.inputs import OperatingPoint
from hmcvt_ros.outputs import ADVICE
from hmcvt_tools import Controller, Drive, load_vehicle

pytestmark = pytest.mark.slow

FILE, ENGINE_FILE = (
    hmcvt.data_path(f"params/{name}.yaml") for name in ("tractor", "engine")
)
TRACTOR, ENGINE = hmcvt.load_model(FILE), hmcvt.load_engine(ENGINE_FILE)


@pytest.fixture(scope="module")
def tractor(start_node):
    node = start_node(FILE, engine_file=ENGINE_FILE)
    player = node.player
    node.heard = []
    player.create_subscription(
        String, "optimal_stage", lambda m: node.heard.append(m.data), qos.OUTPUT
    )
    player.create_subscription(
        JointState, "advice", lambda m: node.heard.append(m), qos.OUTPUT
    )
    stage = player.create_publisher(String, "stage", qos.LATCHED)
    points = player.create_publisher(JointState, "operating_point", qos.INPUT)
    assert node.comes(
        lambda: stage.get_subscription_count() and points.get_subscription_count()
    )
    node.engage = lambda name: (stage.publish(String(data=name)), player.spin_for(0.2))
    node.ask = points.publish
    return node


def test_silent_before_the_stage_is_known(tractor):
    assert tractor.player.hold(GOOD, patience=0.5) == (None, None)
    assert tractor.comes(
        lambda: (
            "nothing received, and the model has several: H0, HM1"
            in tractor.status("inputs")["message"]
        )
    )


def test_operating_point_without_a_stage_is_counted_once_and_says_so(tractor):
    keys = ("received", "accepted", "refused, no stage")

    def counts():
        tractor.forget_status()
        assert tractor.comes(lambda: "inputs" in tractor.player.statuses)
        return [int(tractor.value(f"operating points {key}", "inputs")) for key in keys]

    before = counts()
    tractor.heard.clear()
    sent = 0
    while not tractor.heard and sent < 20:  # best effort
        tractor.ask(bench_sample_to_message(0.4, 150.0, math.nan, 100.0, 300.0))
        sent += 1
        tractor.player.spin_for(0.2)
    assert tractor.heard[0].header.frame_id == f"{TRACTOR.fingerprint}:unknown"
    assert all(map(math.isnan, tractor.heard[0].position))
    received, accepted, refused = np.subtract(counts(), before)
    assert accepted == 0 and 1 <= refused == received <= sent


def test_every_answer_is_of_the_stage_engaged(tractor):
    for name in ("HM4", "HM1", "HM3", "HM2", "HM4", "HM3"):
        model = TRACTOR.stages[name]
        tractor.engage(name)
        for point in (GOOD, OperatingPoint(-0.3, 150.0, 120.0)):
            assert tractor.player.hold(point, rounds=1) == (
                model.efficiency(*point),
                model.optimal_displacement_ratio(*point[1:]).displacement_ratio,
            )
        assert tractor.heard[-1] == name


def test_a_new_stage_answers_the_inputs_of_now_at_once(tractor):
    tractor.engage("HM2")
    tractor.player.hold(GOOD, rounds=1)
    for name in ("HM3", "HM1", "HM4"):
        tractor.player.send_inputs(GOOD)
        tractor.player.spin_for(0.1)
        tractor.player.efficiencies.clear()
        tractor.engage(name)
        assert tractor.player.efficiencies == [TRACTOR.stages[name].efficiency(*GOOD)]


def test_an_unknown_stage_silences(tractor):
    tractor.engage("HM9")
    assert tractor.player.hold(GOOD, patience=0.5) == (None, None)
    assert tractor.comes(
        lambda: (
            "stage 'HM9' is not known; there is H0"
            in tractor.status("inputs")["message"]
        )
    )
    tractor.engage("HM4")
    assert tractor.player.hold(GOOD)[0] == TRACTOR.stages["HM4"].efficiency(*GOOD)


def test_advice_names_the_stage_and_the_fuel(tractor):
    tractor.engage("HM3")
    model, point = TRACTOR.stages["HM3"], (0.4, 150.0, 200.0)
    output = model.output_speed(*point)
    tractor.heard.clear()
    tractor.ask(
        bench_sample_to_message(0.4, 150.0, math.nan, output, 200.0 * 150.0 / output)
    )
    assert tractor.comes(
        lambda: any(isinstance(item, JointState) for item in tractor.heard)
    )
    answer = next(item for item in tractor.heard if isinstance(item, JointState))
    assert answer.header.frame_id == f"{TRACTOR.fingerprint}:HM3"
    told = dict(zip(ADVICE, answer.position, strict=True))
    load = 200.0 * 150.0 / output * output / 150.0
    assert told["efficiency"] == pytest.approx(
        model.efficiency(0.4, 150.0, load), rel=1e-12
    )
    assert told["fuel_rate"] == pytest.approx(
        ENGINE.fuel_rate(150.0, load / told["efficiency"]), rel=1e-12
    )


def test_drive_line_at_a_held_output_speed(tractor):
    tractor.engage("HM2")
    tractor.set(optimum_hold="output_speed")
    point = OperatingPoint(0.3, 190.0, 150.0)
    limits = (78.54, 230.38)
    best = TRACTOR.optimal_drive(
        TRACTOR.stages["HM2"].output_speed(*point),
        190.0 * 150.0,
        engine=ENGINE,
        engine_speed_limits=limits,
    )
    tractor.heard.clear()
    assert tractor.player.hold(point)[1] == best.displacement_ratio
    assert tractor.heard[-1] == best.stage
    tractor.set(optimum_hold="engine_speed")


def test_the_causal_strategy_answers_with_a_vehicle(start_node):
    vehicle_file = hmcvt.data_path("params/vehicle.yaml")
    node = start_node(
        FILE,
        engine_file=ENGINE_FILE,
        vehicle_file=vehicle_file,
        optimum_hold="output_speed",
    )
    stage = node.player.create_publisher(String, "stage", qos.LATCHED)
    assert node.comes(lambda: stage.get_subscription_count())
    stage.publish(String(data="HM2"))
    node.player.spin_for(0.2)
    point = OperatingPoint(0.3, 190.0, 150.0)
    controller = Controller(Drive(TRACTOR, ENGINE, load_vehicle(vehicle_file)))
    command = controller.choose(
        TRACTOR.stages["HM2"].output_speed(*point),
        190.0 * 150.0,
        "HM2",
        point.engine_speed,
        point.displacement_ratio,
    )
    assert node.player.hold(point)[1] == pytest.approx(command.displacement_ratio)


def test_bench_samples_keep_their_stage_through_refit_and_diagnosis(tractor):
    """Of the stage that the message names, however topics overtake each other, or of `stage`."""
    rng, sent = np.random.default_rng(3), []
    worn = replace(TRACTOR, parameters=replace(TRACTOR.parameters, leakage=4.5e-11))
    for engaged, named in (
        ("HM2", ""),
        ("HM4", "base_link"),
        ("HM4", "HM3"),
        ("HM4", "HM8"),
        ("HM9", ""),
    ):
        tractor.engage(engaged)
        name = named if named in TRACTOR.stages else engaged
        source = f"from topic stage: header.frame_id {named!r} is no stage of the model"
        if named == name:
            source = "from header.frame_id"
        elif not named:
            source = "from topic stage"
        for _ in range(8 if name in TRACTOR.stages else 1):
            stroke, speed, load = (
                float(rng.uniform(*ends))
                for ends in ((-0.9, 0.9), (90.0, 210.0), (80.0, 300.0))
            )
            model = worn.stages.get(name, worn.stages["HM4"])
            output = model.output_speed(stroke, speed, load)
            sample = bench_sample_to_message(
                stroke,
                speed,
                load / model.efficiency(stroke, speed, load),
                output,
                load * speed / output,
            )
            sample.header.frame_id = named
            tractor.player.send_sample(sample)
            sent += [name] if name in TRACTOR.stages else []
        count = len(sent)
        assert tractor.comes(lambda count=count: tractor.logged() == count)
        if name in TRACTOR.stages:
            expected = f"{name}, {source}"
            assert tractor.comes(
                lambda expected=expected: (
                    tractor.value("stage of the last bench sample") == expected
                )
            ), tractor.value("stage of the last bench sample")
    assert tractor.says("bench_sample: stage 'HM9' is not known")
    assert tractor.says("frame_id 'HM8' is no stage of the model; taken as HM4")
    assert "'base_link' is no stage of the model; taken" not in tractor.log
    assert list(hmcvt.read_bench(tractor.bench_file).extra["stage"]) == sent
    diagnosed = tractor.player.call("diagnose").data
    assert (
        diagnosed["gap"]["samples"] == len(sent) == 32
        and diagnosed["gap"]["rmse"] < 1e-3
    )
    refitted = tractor.player.call("reidentify").data
    assert refitted["parameters"]["leakage"]["value"] == pytest.approx(
        4.5e-11, rel=0.01
    )
    tractor.engage("HM3")
    served = hmcvt.load_model(tractor.state / refitted["file"]).stages["HM3"]
    assert tractor.player.hold(GOOD)[0] == served.efficiency(*GOOD)
    assert tractor.player.call("revert").success


def test_a_log_with_stages_and_one_without_are_never_mixed(tmp_path):
    one, many = (
        {
            "displacement_ratio": 0.5,
            "engine_speed": 150.0,
            "load_torque": 200.0,
            "efficiency": 0.8,
            "output_speed": 180.0,
            "stamp": 1.0,
            "extra": extra,
        }
        for extra in ({}, {"stage": ("HM4",)})
    )
    path = tmp_path / "log.csv"
    BenchLog(path, 9).write(rows_of(hmcvt.BenchSamples(**one)))
    log = BenchLog(path, 9, stages=True)
    assert len(log) == 0 and "set aside" in log.recovered
    log.write(rows_of(hmcvt.BenchSamples(**many)))
    assert hmcvt.read_bench(path).extra["stage"] == ("HM4",)
    assert len(BenchLog(path, 9, stages=True)) == 1
    (aside,) = tmp_path.glob("log.cleared-*")
    assert len(hmcvt.read_bench(aside)) == 1
    with pytest.raises(hmcvt.InputError, match="no name for a log"):
        rows_of(hmcvt.BenchSamples(**{**many, "extra": {"stage": ("H,1",)}}))


def test_one_stage_needs_no_word(node):
    heard = []
    node.player.create_subscription(
        String, "optimal_stage", lambda m: heard.append(m.data), qos.OUTPUT
    )
    assert node.comes(lambda: (node.player.hold(GOOD, rounds=1), heard)[1])
    assert set(heard) == {"HM4"}
