# SPDX-License-Identifier: Apache-2.0
"""The diagnoser knows nothing of the blind twin, and needs neither ROS nor plots."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import hmcvt_core
from hmcvt_core.fleet.threads import ONE_BLAS_THREAD
from hmcvt_core.physics.effects.drag import ChargePump

from .campaigns import BASE, campaign

ROOT = Path(hmcvt_core.__file__).parent
FORBIDDEN = ("hmcvt_core.blind", "hmcvt_ros", "rclpy", "matplotlib", "yaml")

RUN = """
import json, sys
import hmcvt_core.diagnosis
from hmcvt_core import BenchSamples, EfficiencyModel, HydraulicParameters, Stage, diagnose
data = json.load(sys.stdin)
model = EfficiencyModel(Stage.from_mapping(data["stage"]), HydraulicParameters(2e-11, 0.12, 0.2))
found = diagnose(model, BenchSamples(**data["samples"]), noise=0.003)
print(json.dumps({"verdict": found.verdict, "modules": sorted(sys.modules)}))
"""

TIME = """
import json, sys, time
from hmcvt_core import BenchSamples, EfficiencyModel, HydraulicParameters, Stage, diagnose
data = json.load(sys.stdin)
model = EfficiencyModel(Stage.from_mapping(data["stage"]), HydraulicParameters(2e-11, 0.12, 0.2))
taken = []
for columns in data["samples"]:
    samples = BenchSamples(**columns)
    start = time.process_time()
    diagnose(model, samples, noise=0.003)
    taken.append(time.process_time() - start)
print(json.dumps(taken))
"""


def _columns(samples):
    return {name: getattr(samples, name).tolist() for name in (
        "displacement_ratio", "engine_speed", "load_torque", "efficiency", "output_speed")}


def _run(script, samples):
    # A single core, whatever the machine has.
    environment = {**os.environ, **ONE_BLAS_THREAD, "PYTHONPATH": str(ROOT.parent)}
    done = subprocess.run([sys.executable, "-c", script], env=environment, text=True, check=True,
                          input=json.dumps({"stage": BASE.stage.to_mapping(), "samples": samples}),
                          capture_output=True)
    return json.loads(done.stdout)


def _imported(path):
    """Modules that a file imports, by full name."""
    package = ["hmcvt_core", *path.relative_to(ROOT).parts[:-1]]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[:len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *filter(None, [node.module])])
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)


def test_a_diagnosis_loads_no_twin_no_ros_no_plots():
    outcome = _run(RUN, _columns(campaign((ChargePump(8.0),), seed=1, n=48)))
    assert outcome["verdict"] in ("ambiguous", "cause_found")
    for name in outcome["modules"]:
        assert not any(name == other or name.startswith(f"{other}.") for other in FORBIDDEN), name


def test_no_file_of_the_diagnoser_imports_the_twin():
    files = [*ROOT.glob("diagnosis/**/*.py"), *ROOT.glob("effects/*.py"), *ROOT.glob("*.py")]
    assert len(files) > 30
    seen = set()
    for path in files:
        for name in _imported(path):
            seen.add(name)
            assert not name.startswith("hmcvt_core.blind"), path
    assert "hmcvt_core.effects.base.Effect" in seen, "the scan resolves relative imports"
    # The scan can fail: the twin's own files do import the twin.
    assert any(name.startswith("hmcvt_core.blind")
               for path in ROOT.glob("blind/*.py") for name in _imported(path))


def test_one_diagnosis_takes_seconds_and_grows_no_faster_than_linearly():
    few, many = (_columns(campaign((ChargePump(8.0),), seed=1, n=n)) for n in (96, 960))
    first, again, large = _run(TIME, [few, few, many])
    assert max(first, again) < 5.0, "design: 96 samples on one core"
    assert large < 15.0 * min(first, again)
    assert np.isfinite(large)
