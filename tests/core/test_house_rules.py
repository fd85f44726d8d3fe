# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the core promises about itself: layers, light imports, documented public names."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import hmcvt_core as hmcvt

SOURCE = Path(hmcvt.__file__).parent
HEAVY = ("rclpy", "hmcvt_ros", "studies", "yaml", "jinja2", "matplotlib", "click", "rosbags")


def test_layers_hold_without_a_circle():
    """pyproject.toml names the layers; imports inside functions and for types alone count."""
    linter = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([linter, "--no-cache"], cwd=SOURCE.parent, capture_output=True, text=True,
                          timeout=120)
    assert done.returncode == 0, done.stdout
    assert "Contracts: 5 kept, 0 broken." in done.stdout


def test_import_is_light():
    done = subprocess.run(
        [sys.executable, "-c", "import hmcvt_core, sys; print('\\n'.join(sys.modules))"],
        capture_output=True, text=True, check=True, cwd=SOURCE.parent, timeout=60)
    loaded = set(done.stdout.split())
    assert "hmcvt_core.physics" in loaded
    assert not loaded & set(HEAVY)


@pytest.mark.parametrize("name", sorted(set(hmcvt.__all__) - {"__version__"}))
def test_public_name_is_documented(name):
    item = getattr(hmcvt, name)
    # Not the signature that a dataclass writes in place of a missing docstring.
    assert item.__doc__
    assert not item.__doc__.startswith(f"{name}(")
    if inspect.isclass(item):
        for method_name, method in vars(item).items():
            if callable(method) and not method_name.startswith("_"):
                assert inspect.getdoc(method), f"{name}.{method_name}"


def test_all_is_sorted_and_complete():
    assert list(hmcvt.__all__) == sorted(hmcvt.__all__)
    imported = {name for name, item in vars(hmcvt).items()
                if not name.startswith("_") and not inspect.ismodule(item)}
    assert imported <= set(hmcvt.__all__)


def test_the_house_stays_small():
    files = sorted(SOURCE.rglob("*.py"))
    assert len(files) <= 94
    assert all(len(file.read_text(encoding="utf-8").splitlines()) <= 400 for file in files)
    entries = [path for path in SOURCE.iterdir() if path.name != "__pycache__"]
    assert len(entries) <= 14, entries


def test_every_error_raised_on_purpose_is_one_line():
    assert str(hmcvt.InputError("a\nb\r\nc")) == "a b c"
    assert len(str(hmcvt.InputError("x" * 10_000))) == 1000
    assert issubclass(hmcvt.InputError, hmcvt.HmcvtError)
    assert issubclass(hmcvt.HmcvtError, ValueError)
