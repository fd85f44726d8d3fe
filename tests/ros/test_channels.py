# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Oil temperature, pressure and session reach the model, the log and the diagnosis."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from core.test_refit import campaign
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD, message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_ros import jobs, qos
from hmcvt_ros.bench_log import BenchLog, rows_of
from hmcvt_ros.outputs import ADVICE, depends_on_oil
from hmcvt_tools.cli import main

pytestmark = pytest.mark.slow

HM4 = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
MODEL = replace(
    HM4,
    effects=(OilTemperature(1.0),),
    domain=replace(HM4.domain, oil_temperature=(35.0, 85.0)),
)


def stating(sent, **values):
    """Return a message with further joints."""
    for name, value in values.items():
        sent.name.append(name)
        sent.position.append(float(value))
        sent.velocity.append(math.nan)
        sent.effort.append(math.nan)
    return sent


@pytest.fixture(scope="module")
def oil_node(start_node, tmp_path_factory):
    path = tmp_path_factory.mktemp("oil") / "oil.yaml"
    hmcvt.save_model(MODEL, path)
    # A busy machine holds up points, which are not the subject here.
    return start_node(path, input_timeout=10.0)


@pytest.fixture(scope="module")
def ask(oil_node):
    """Ask at a point of shafts, with what the message states; the advice by name."""
    player = oil_node.player
    asked = player.create_publisher(JointState, "operating_point", qos.INPUT)
    heard = []
    player.create_subscription(JointState, "advice", heard.append, qos.OUTPUT)
    assert oil_node.comes(
        lambda: asked.get_subscription_count() and player.count_publishers("advice"),
        20.0,
    )

    def ask(samples, i=0, **stated):
        for number in range(10):  # best effort
            heard.clear()
            sent = stating(message(samples, i), **stated)
            sent.header.stamp.nanosec = number
            asked.publish(sent)
            if oil_node.comes(lambda: heard, 2.0):
                return dict(zip(ADVICE, heard[-1].position, strict=True))
        raise TimeoutError

    return ask


def test_answers_follow_the_oil_and_state_when_it_is_unknown(oil_node, ask, table2):
    points = [
        tuple(map(float, point)) for point in zip(*table2.points[:3], strict=True)
    ]
    unknown = [ask(table2, i) for i in range(len(table2))]
    assert oil_node.reports(
        DiagnosticStatus.WARN,
        "oil_temperature: unknown, and the model depends on it",
        part="inputs",
        send=GOOD,
    ), oil_node.status("inputs")
    assert oil_node.value("oil temperature [deg C]", "inputs") == "unknown"
    errors = []
    for point, answer in zip(points, unknown, strict=True):
        assert answer["efficiency"] == pytest.approx(MODEL.efficiency(*point), rel=1e-9)
        assert answer["efficiency_std"] > MODEL.predict(*point).standard_error
        for temperature in (35.0, 85.0):
            error = abs(answer["efficiency"] - MODEL.efficiency(*point, temperature))
            errors.append(error)
            assert error < 1.96 * answer["efficiency_std"], (point, temperature)
    assert max(errors) > 0.01
    for i, point in enumerate(points):
        for temperature in (35.0, 85.0):
            answer = ask(table2, i, oil_temperature=temperature)
            truth = MODEL.predict(*point, temperature)
            assert answer["efficiency"] == pytest.approx(truth.efficiency, rel=1e-9)
            assert answer["efficiency_std"] == pytest.approx(
                truth.standard_error, rel=1e-9
            )
            best = MODEL.optimal_displacement_ratio(
                *point[1:], oil_temperature=temperature
            )
            assert answer["optimal_displacement_ratio"] == pytest.approx(
                best.displacement_ratio, abs=1e-9
            )
    refused = ask(table2, 0, oil_temperature=340.0)
    assert all(map(math.isnan, refused.values()))
    assert oil_node.says("oil_temperature = 340 is outside -40 to 150 deg C (is it in")


def test_oil_beyond_the_data_of_the_model_is_extrapolation(oil_node, ask, table2):
    for temperature, extrapolated in ((85.0, 0.0), (20.0, 1.0), (100.0, 1.0)):
        answer = ask(table2, 0, oil_temperature=temperature)
        assert answer["extrapolated"] == extrapolated, temperature
        assert math.isfinite(answer["efficiency"])
    # The last point has stated the temperature for the plain inputs too.
    words = "extrapolation: oil_temperature 100 deg C is not in 35 to 85 deg C"
    assert oil_node.reports(DiagnosticStatus.WARN, words, send=GOOD)
    assert oil_node.value("extrapolation").startswith("oil_temperature 100 deg C")
    assert ask(table2, 0, oil_temperature=60.0)["extrapolated"] == 0.0
    assert oil_node.comes(lambda: oil_node.value("extrapolation") == "no")


def test_oil_temperature_comes_by_a_topic_too(oil_node, ask, table2):
    player = oil_node.player
    topic = player.create_publisher(Float64, "oil_temperature", qos.INPUT)
    assert oil_node.comes(topic.get_subscription_count, 20.0)

    def served():
        topic.publish(Float64(data=85.0))
        player.spin_for(0.05)
        return player.hold(GOOD).efficiency == pytest.approx(
            MODEL.efficiency(*GOOD, 85.0), rel=1e-12
        )

    assert oil_node.comes(served, 20.0)
    assert oil_node.comes(
        lambda: oil_node.value("oil temperature [deg C]", "inputs") == "85.0"
    )
    # In kelvin: no word of the model, which serves on, but of the topic.
    topic.publish(Float64(data=358.0))
    words = "oil_temperature = 358 is outside"
    assert oil_node.reports(DiagnosticStatus.WARN, words, part="inputs")
    topic.publish(Float64(data=85.0))
    # A bench sample takes it, unless it states another.
    player.send_sample(stating(message(table2, 0), pressure=2e7, session=3))
    player.send_sample(stating(message(table2, 1), oil_temperature=50.0))
    player.send_sample(stating(message(table2, 2), session=1.5))
    assert oil_node.comes(lambda: oil_node.logged() == 2)
    sessions = player.create_publisher(Int32, "session", qos.LATCHED)
    sessions.publish(Int32(data=4))
    assert oil_node.comes(lambda: oil_node.value("session", "inputs") == "4", 20.0)
    player.send_sample(message(table2, 3))
    player.send_sample(stating(message(table2, 4), session=5))
    assert oil_node.comes(lambda: oil_node.logged() == 4)
    columns = hmcvt.read_bench(oil_node.bench_file).extra
    assert columns["stated_oil_temperature"] == ("85.0", "50.0", "85.0", "85.0")
    assert columns["stated_pressure"] == ("20000000.0", "", "", "")
    assert columns["stated_session"] == ("3", "", "4", "5")
    assert oil_node.reports(DiagnosticStatus.WARN, "session = 1.5 is no whole number")
    player.destroy_publisher(topic)
    player.destroy_publisher(sessions)


def test_joint_that_is_not_used_is_named_and_a_doubled_one_refused(oil_node, table2):
    before = oil_node.logged()
    oil_node.player.send_sample(stating(message(table2, 5), oil_temperture=50.0))
    assert oil_node.comes(lambda: oil_node.logged() == before + 1)
    assert oil_node.says("bench_sample: joint 'oil_temperture' is not used")
    doubled = stating(message(table2, 6), oil_temperature=50.0)
    oil_node.player.send_sample(stating(doubled, oil_temperature=70.0))
    words = "bench_sample: joint 'oil_temperature' stands 2 times in name"
    assert oil_node.reports(DiagnosticStatus.WARN, words)
    assert oil_node.logged() == before + 1


def test_model_without_oil_is_not_widened():
    assert depends_on_oil(MODEL)
    assert not depends_on_oil(replace(MODEL, effects=()))


def test_quantity_that_some_samples_lack_is_left_out_and_told(tmp_path, table2):
    log = BenchLog(tmp_path / "log.csv", 100)
    stamped = replace(
        table2, stamp=np.arange(8.0), output_speed=np.full(8, 90.0), sha256="", rows=()
    )
    log.write(rows_of(stamped.select([0, 1, 2])))
    warm = replace(stamped, oil_temperature=np.full(8, 70.0))
    log.write(rows_of(warm.select([3, 4])))
    bench = jobs.bench_of(log.path)
    assert bench.oil_temperature is None
    assert jobs.left_out(bench) == [
        "oil_temperature is left out: 2 of 5 samples state it"
    ]


def test_diagnosis_of_the_node_is_that_of_the_command_line(
    start_node, tmp_path, capsys
):
    base = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    rng = np.random.default_rng(5)
    samples = campaign(base, 30, 0)
    temperature = np.round(rng.uniform(40.0, 80.0, len(samples)), 1)
    points = samples.points._replace(oil_temperature=temperature)
    truth = replace(base, effects=(OilTemperature(1.5),))
    read = truth.readings_at(points)
    pressure = read["pressure"]
    charge = np.round(rng.uniform(1.9e6, 2.3e6, len(samples)), -3)
    samples = replace(
        samples,
        efficiency=read["efficiency"] + rng.normal(0.0, 0.002, len(samples)),
        output_speed=read["output_speed"],
        pressure=pressure,
        charge_pressure=charge,
        oil_temperature=temperature,
        stamp=1000.0 + 60.0 * np.arange(len(samples)),
        extra={"session": tuple(str(i // 15) for i in range(len(samples)))},
    )
    hmcvt.write_bench(tmp_path / "bench.csv", samples)
    node = start_node(hmcvt.data_path("params/hm4.yaml"), bench_noise=0.002)
    for i in range(len(samples)):
        sent = stating(
            shaft_message(samples, i),
            oil_temperature=temperature[i],
            pressure=pressure[i],
            charge_pressure=charge[i],
            session=i // 15,
        )
        sent.header.stamp.sec = round(samples.stamp[i])
        node.player.send_sample(sent)
    assert node.comes(lambda: node.logged() == len(samples), 20.0)
    logged = jobs.bench_of(node.bench_file)
    assert logged.columns.keys() == samples.columns.keys()
    for name, values in samples.columns.items():
        np.testing.assert_allclose(logged.columns[name], values, rtol=1e-12)
    answer = node.player.call("diagnose").data
    command = ["diagnose", str(tmp_path / "bench.csv"), "--noise", "0.002", "--json"]
    with pytest.raises(SystemExit):
        main([*command, "--params", str(hmcvt.data_path("params/hm4.yaml"))])
    expected = json.loads(capsys.readouterr().out)
    assert answer["left_out"] == []
    # Without `bench_noise` 1.12 % of the efficiency.
    assert answer["gap"]["noise"] == pytest.approx(expected["gap"]["noise"])
    assert answer["verdict"] == expected["verdict"]
    assert "oil_temperature" in answer["sets"][0]["effects"]
    assert [each["effects"] for each in answer["sets"]] == [
        each["effects"] for each in expected["sets"]
    ]
    np.testing.assert_allclose(
        [each["probability"] for each in answer["sets"]],
        [each["probability"] for each in expected["sets"]],
        atol=1e-3,
    )


def shaft_message(samples, i):
    """Return a message whose readings give the values of a sample."""
    power = float(samples.load_torque[i] * samples.engine_speed[i])
    speed, output = float(samples.engine_speed[i]), float(samples.output_speed[i])
    return JointState(
        name=["engine", "output", "displacement"],
        velocity=[speed, output, math.nan],
        effort=[power / float(samples.efficiency[i]) / speed, power / output, math.nan],
        position=[math.nan, math.nan, float(samples.displacement_ratio[i])],
    )
