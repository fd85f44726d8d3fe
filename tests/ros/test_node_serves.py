# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node answers its inputs with what the model says, and with nothing else."""

import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from ros_bench import GOOD, STALLED, points, send_table
from std_msgs.msg import Float64, Float64MultiArray, String

import hmcvt_core as hmcvt
from examples.bench_player import bench_sample_to_message
from hmcvt_ros import messages, qos

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def model(paper_file):
    return hmcvt.load_model(paper_file)


def best(model, point=GOOD, **options):
    return model.optimal_displacement_ratio(
        point.engine_speed, point.load_torque, **options
    ).displacement_ratio


def test_every_bench_test_gets_exactly_the_answer_of_the_model(node, model, table2):
    for point in points(table2):
        assert node.player.hold(point) == (model.efficiency(*point), best(model, point))


def test_diagnostics_are_good_while_inputs_flow(node, model):
    assert node.reports(
        DiagnosticStatus.OK, "three fresh inputs", part="inputs", send=GOOD
    )
    assert float(node.value("engine_speed age [s]", "inputs")) < 0.5
    assert node.value("fingerprint") == model.fingerprint
    assert node.says("serving ") and "comes with hmcvt" not in node.log  # it was named


def test_late_joiner_gets_model_and_map(node, model, tmp_path):
    late = node.connect(node.namespace)
    assert late.wait_until(
        lambda: late.model_text is not None and late.map is not None, 10.0
    )
    copy = tmp_path / "copy.yaml"
    copy.write_text(late.model_text)
    assert hmcvt.load_model(copy).fingerprint == model.fingerprint
    served = yaml.safe_load(late.model_text)["served"]
    assert served["fingerprint"] == model.fingerprint
    assert served["since"].endswith("Z")

    expected = messages.map_to_message(
        model.efficiency_map(
            np.linspace(-1.0, 1.0, 41),
            np.linspace(78.54, 230.38, 17),
            np.linspace(50.0, 400.0, 15),
        )
    )
    assert late.map.layout == expected.layout
    np.testing.assert_allclose(late.map.data, expected.data, rtol=1e-12)
    assert np.isfinite(late.map.data[late.map.layout.data_offset :]).any()


def test_point_without_an_answer_is_silence_and_a_warning(node, model):
    assert np.isnan(model.efficiency(*STALLED))
    node.player.hold(GOOD)
    assert node.player.hold(STALLED, patience=0.0).efficiency is None
    assert node.reports(
        DiagnosticStatus.WARN, "the load cannot be carried", send=STALLED
    )


def test_rate_limit_answers_the_last_of_a_burst(node, model):
    player = node.player
    node.set(max_output_rate=20.0)
    player.hold(GOOD)
    player.efficiencies.clear()
    for _ in range(100):
        player.send_inputs(GOOD)
        player.spin_for(0.01)
    last = GOOD._replace(load_torque=210.0)
    player.send_inputs(last)
    assert node.comes(lambda: player.efficiencies[-1] == model.efficiency(*last), 2.0)
    assert 10 <= len(player.efficiencies) <= 40


# --- NaN instead of silence -----------------------------------------------------------------------


@pytest.fixture
def nan_node(node):
    assert all(
        result.successful
        for result in node.set(invalid_output="nan", input_timeout=0.3)
    )
    return node


def test_nan_is_repeated_while_there_is_nothing_to_answer(nan_node):
    player = nan_node.player
    nan_node.comes(lambda: player.optima and math.isnan(player.optima[-1]), 2.0)
    player.efficiencies.clear()
    player.optima.clear()
    player.spin_for(1.0)
    for values in (player.efficiencies, player.optima):
        assert 5 <= len(values) <= 15
        assert all(map(math.isnan, values))
    assert nan_node.set(invalid_output="silence")[0].successful
    player.efficiencies.clear()
    player.spin_for(0.3)
    assert player.efficiencies == []


def test_fresh_inputs_are_answered_and_turn_to_nan_when_stale(nan_node, model):
    player = nan_node.player
    assert player.hold(GOOD).efficiency == model.efficiency(*GOOD)
    assert nan_node.comes(lambda: math.isnan(player.efficiencies[-1]), 2.0)
    assert nan_node.comes(lambda: math.isnan(player.optima[-1]), 2.0)
    assert player.hold(GOOD).efficiency == model.efficiency(*GOOD)
    assert math.isnan(player.hold(STALLED).efficiency)  # a point without an answer


def test_every_refused_message_gives_nan_at_once(nan_node):
    player = nan_node.player
    nan_node.set(input_timeout=20.0)  # none of the periodic ones
    player.hold(GOOD)
    player.efficiencies.clear()
    player._inputs[1].publish(player._inputs[1].msg_type(data=math.inf))
    assert nan_node.comes(lambda: any(map(math.isnan, player.efficiencies)), 2.0)
    assert math.isfinite(player.hold(GOOD).efficiency)


def test_one_input_may_be_older_than_the_others(node):
    player = node.player
    node.set(input_timeout=0.3, input_timeouts__load_torque=10.0)
    assert player.hold(GOOD).efficiency is not None
    player.spin_for(0.4)

    def answered(*which):
        player.efficiencies.clear()
        for i in which:
            player._inputs[i].publish(player._inputs[i].msg_type(data=GOOD[i]))
        return node.comes(lambda: player.efficiencies, 0.25)

    assert answered(0, 1)  # with a load torque that may be 10 s old
    player.spin_for(0.4)
    assert not answered(1, 2)  # with a displacement ratio that may be 0.3 s
    assert node.comes(lambda: node.value("load_torque age limit [s]", "inputs") == "10")
    assert node.value("engine_speed age limit [s]", "inputs") == "0.3"
    assert node.set(input_timeouts__displacement_ratio=10.0)[0].successful
    assert answered(1, 2)


def test_optimum_is_that_of_the_settings_and_the_model_now(node, table2, model):
    player = node.player
    node.set(input_timeout=10.0)
    assert player.hold(GOOD).optimal_displacement_ratio == best(model)
    for hold, limits in (
        ("output_speed", [78.54, 230.38]),
        ("output_speed", [90.0, 120.0]),
        ("engine_speed", [90.0, 120.0]),
    ):
        node.set(optimum_hold=hold, engine_speed_limits=limits)
        ratio = GOOD.displacement_ratio if hold == "output_speed" else None
        assert player.hold(GOOD).optimal_displacement_ratio == best(
            model,
            hold=hold,
            displacement_ratio=ratio,
            engine_speed_limits=tuple(limits),
        )

    # With the output speed held, another displacement ratio is another question.
    node.set(optimum_hold="output_speed")
    player.hold(GOOD)
    other = GOOD._replace(displacement_ratio=0.3)
    assert player.hold(other).optimal_displacement_ratio == best(
        model,
        hold="output_speed",
        displacement_ratio=0.3,
        engine_speed_limits=(90.0, 120.0),
    )

    # Another model is, too, although the inputs stay.
    node.set(optimum_hold="engine_speed")
    send_table(node, table2)
    before = player.hold(GOOD).optimal_displacement_ratio
    assert before == best(model)
    reply = player.call("reidentify")
    assert reply.success, reply.data
    refitted = best(hmcvt.load_model(node.state / reply.data["file"]))
    assert player.hold(GOOD).optimal_displacement_ratio == refitted != before


def test_parameter_changes_are_checked(node):
    for name, value, word in [
        ("input_timeout", 0.0, "0.01"),
        ("input_timeout", math.nan, ""),
        ("engine_speed_limits", [230.0, 80.0], "rising"),
        ("model_file", "/etc/passwd", "read-only"),
    ]:
        (result,) = node.set(**{name: value})
        assert not result.successful, (name, value)
        assert word in result.reason
    assert node.set(engine_speed_limits=[80.0, 200.0])[0].successful
    assert node.comes(lambda: node.player.map.data[41] == 80.0)


# --- bad, stale and missing inputs ----------------------------------------------------------------


BAD = [
    ("engine_speed", math.nan, "not finite"),
    ("load_torque", math.inf, "not finite"),
    ("engine_speed", 750.0, "r/min"),
    ("displacement_ratio", 1.3, "-1 to 1"),
    ("load_torque", -9000.0, "1 to 5000 N m"),
]


def test_before_all_three_are_there_and_when_they_are_wrong(start_node, paper_file):
    """A node of its own: its first messages, and the warnings in its log."""
    node = start_node(paper_file)
    assert node.reports(
        DiagnosticStatus.WARN, "engine_speed: nothing received", part="inputs"
    )
    for publisher, value in zip(node.player._inputs[:2], GOOD, strict=False):
        for _ in range(5):
            publisher.publish(publisher.msg_type(data=value))
            node.player.spin_for(0.02)
    assert node.player.efficiencies == [] and node.player.optima == []

    bad = GOOD._replace(engine_speed=2000.0, load_torque=math.nan)
    node.player.hold(bad, rounds=20, patience=0.0)  # 40 refused messages
    assert node.says("engine_speed = 2000 is outside 10 to 320 rad/s (is it in r/min?)")
    assert node.says("load_torque = nan is not finite")
    assert node.log.count("[WARN]") == 2


@pytest.mark.parametrize(("name", "value", "word"), BAD)
def test_bad_value_silences_the_node_until_a_good_one_comes(node, name, value, word):
    assert node.player.hold(GOOD).efficiency is not None
    bad = GOOD._replace(**{name: value})
    # On a busy machine it may lag behind for a while.
    assert any(node.player.hold(bad, patience=0.0) == (None, None) for _ in range(3))
    assert node.reports(DiagnosticStatus.ERROR, name, word, part="inputs", send=bad)
    reason = "out of range" if math.isfinite(value) else "not finite"
    assert int(node.value(f"{name} refused, {reason}", "inputs")) > 0
    assert node.player.hold(GOOD).efficiency is not None


def test_stale_input_silences_the_node(node):
    node.set(input_timeout=0.3)
    assert node.player.hold(GOOD).efficiency is not None
    node.player.spin_for(0.4)
    node.player.efficiencies.clear()
    for _ in range(8):
        for publisher, value in zip(node.player._inputs[:2], GOOD, strict=False):
            publisher.publish(publisher.msg_type(data=value))
        node.player.spin_for(0.05)
    assert node.player.efficiencies == []
    assert node.reports(
        DiagnosticStatus.WARN, "load_torque: nothing received for", part="inputs"
    )
    assert node.player.hold(GOOD).efficiency is not None


# --- among others, in a flood ---------------------------------------------------------------------


@pytest.fixture
def stranger(environment):
    """A node of a participant of its own: within one, a topic has one type."""
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("stranger", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


def test_stranger_on_the_domain_does_no_harm(node, paper_file, stranger: Node):
    def counts():
        return [
            node.value(f"{name} refused, {reason}", "inputs")
            for name in GOOD._fields
            for reason in ("not finite", "out of range")
        ] + [node.value("bench samples received")]

    node.forget_status()
    assert node.comes(lambda: all(counts()))
    before = counts()
    space = node.namespace
    model = hmcvt.load_model(paper_file)
    # Other types on the topics of the node, its own outputs among them.
    wrong = [
        (stranger.create_publisher(kind, f"{space}/{topic}", profile), kind())
        for kind, topic, profile in [
            (String, "engine_speed", qos.INPUT),
            (Float64MultiArray, "load_torque", 10),
            (String, "bench_sample", qos.BENCH_SAMPLE),
            (String, "efficiency", qos.OUTPUT),
            (Float64, "hmcvt/model", qos.LATCHED),
            (Float64, "hmcvt/efficiency_map", 10),
        ]
    ]
    # The diagnostics of someone else, in good shape and in bad.
    other = stranger.create_publisher(DiagnosticArray, "/diagnostics", 10)
    status = DiagnosticStatus(name="camera: frames", level=DiagnosticStatus.ERROR)
    arrays = [DiagnosticArray(), DiagnosticArray(status=[status] * 50)]
    flood = stranger.create_publisher(String, f"{space}/unrelated", 10)
    noise = String(data="x" * 10_000)

    for _ in range(50):
        for publisher, message in wrong:
            publisher.publish(message)
        for array in arrays:
            other.publish(array)
        for _ in range(20):
            flood.publish(noise)
        node.player.spin_for(0.005)

    assert node.player.hold(GOOD).efficiency == model.efficiency(*GOOD)
    node.forget_status()
    assert node.comes(lambda: all(counts()))
    assert counts() == before
    late = node.connect(space)
    assert late.wait_until(
        lambda: late.model_text is not None and late.map is not None, 10.0
    )
    assert node.process.poll() is None and "Traceback" not in node.log


def memory(node):
    """Resident memory of the node [MB]."""
    pages = int(Path(f"/proc/{node.process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def flood(node, table2, rounds):
    """Send inputs, good and bad, and bench samples that are refused, as fast as it goes."""
    everything = [
        *points(table2),
        GOOD._replace(engine_speed=math.nan),
        GOOD._replace(load_torque=-1.0),
        STALLED,
    ]
    for i in range(rounds):
        point = everything[i % len(everything)]
        # Every round another value, so that nothing can be remembered by it.
        node.player.send_inputs(
            point._replace(load_torque=point.load_torque + i * 1e-6)
        )
        if i % 10 == 0:
            node.player.send_sample(
                bench_sample_to_message(2.0 + i, 100.0, 1.0, 80.0, 1.0)
            )
        node.player.spin_for(0.001)


def test_memory_stays_flat_under_a_flood(node, table2):
    node.set(invalid_output="nan")
    flood(node, table2, 200)  # buffers of the middleware fill up
    before, warnings = memory(node), node.log.count("[WARN]")
    flood(node, table2, 400)
    assert memory(node) - before < 2.0, (before, memory(node))
    assert node.player.hold(GOOD).efficiency is not None
    assert node.log.count("[WARN]") - warnings < 20


# --- an effect of one's own -----------------------------------------------------------------------


EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "own_effect.py"
TIPPED = GOOD._replace(engine_speed=200.0)  # where its block tips


def test_client_states_why_there_is_no_answer(node, connect, capfd):
    """The logger of ROS writes to the stream of the process."""
    node.player.hold(GOOD._replace(displacement_ratio=5.0), patience=2.5)
    assert (
        "no answer: inputs: displacement_ratio = 5 is outside" in capfd.readouterr().err
    )
    node.player.hold(STALLED, patience=2.5)
    assert "; model: the load" in capfd.readouterr().err
    connect("/nowhere").hold(GOOD, patience=0.0)
    assert "no answer: no diagnostics come from the node" in capfd.readouterr().err


def with_own_effect(folder):
    """Write a parameter file with an effect of the user; return it and the file of the effect."""
    path = folder / "tipping.yaml"
    effect = folder / "own_effect.py"
    shutil.copy(EXAMPLE, effect)
    data = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml")).to_mapping()
    data["effects"] = [
        {
            "effect": "tipping_block",
            "parameters": {
                "leak": {"value": 8e-11, "unit": "m3/(s Pa)"},
                "tipping": {"value": 210.0, "unit": "rad/s"},
            },
        }
    ]
    path.write_text(yaml.safe_dump(data))
    return path, effect


def test_an_effect_of_ones_own_is_served_and_refitted(start_node, tmp_path, table2):
    path, effect = with_own_effect(tmp_path)
    node = start_node(path, effects_file=effect)
    answer = node.player.hold(TIPPED).efficiency
    told = subprocess.run(  # in a process of its own: a class stays in the library for good
        [
            sys.executable,
            "-m",
            "hmcvt_tools.cli",
            "predict",
            "--params",
            path,
            "--effects",
            EXAMPLE,
            "--json",
            *(
                word
                for name, value in TIPPED._asdict().items()
                for word in (f"--{name.replace('_', '-')}", str(value))
            ),
        ],
        capture_output=True,
        text=True,
        check=True,
        cwd=EXAMPLE.parents[1],
    )
    assert answer == pytest.approx(json.loads(told.stdout)["efficiency"], rel=1e-9)
    assert (
        answer
        < hmcvt.load_model(hmcvt.data_path("params/hm4.yaml")).efficiency(*TIPPED)
        - 0.001
    )

    send_table(node, table2)
    _, found = node.player.call("reidentify")  # in the worker, which has to know it too
    assert found["samples"] == 8, found
    effect.write_text(f"{effect.read_text()}# edited\n")
    done, found = node.player.call("reidentify")
    assert not done and "own_effect.py was changed after the start" in found["error"]


def test_laws_edited_between_two_starts_are_told_until_a_refit(
    start_node, tmp_path, table2
):
    path, effect = with_own_effect(tmp_path)
    laws = effect.read_text()
    served = {"model_file": path, "state": tmp_path / "state", "effects_file": effect}

    def restarted(text, before=None):
        if before is not None:
            assert before.stop() == 0
        effect.write_text(text)
        return start_node(**served)

    def told(node, name):
        words = f"effects_file was changed since {name} was put into service"
        return node.says("effects_file was changed since") and node.reports(
            DiagnosticStatus.WARN, words
        )

    def intact(node):
        return node.comes(lambda: node.value("state folder") == "intact")

    node = restarted(laws)
    assert intact(node)
    edited = laws.replace("state.pressure", "2.0 * state.pressure")
    assert edited != laws
    node = restarted(edited, node)
    assert told(node, "tipping.yaml")
    node = restarted(laws, node)
    assert intact(node)
    # A refit by the edited laws is the other way out.
    node = restarted(edited, node)
    assert told(node, "tipping.yaml")
    send_table(node, table2)
    done, found = node.player.call("reidentify")
    assert done, found
    if found["staged"]:
        assert told(node, "tipping.yaml")
        assert node.player.call("adopt").success
    assert intact(node)
    node = restarted(edited, node)
    assert intact(node)
    node = restarted(laws, node)
    assert told(node, "models/0001.yaml")
    # The parameter file before was first served by these laws.
    assert node.player.call("revert").success
    assert intact(node)


def test_laws_that_no_model_follows_may_be_edited(start_node, tmp_path):
    _, effect = with_own_effect(tmp_path)
    state = tmp_path / "state"
    node = start_node("''", state=state, effects_file=effect)
    assert node.stop() == 0
    effect.write_text(f"{effect.read_text()}# edited\n")
    node = start_node("''", state=state, effects_file=effect)
    assert node.comes(lambda: node.value("state folder") == "intact")
