# SPDX-License-Identifier: Apache-2.0
"""What the core promises about itself: light imports, no ROS, documented public names."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import hmcvt_core as hmcvt

SOURCE = Path(hmcvt.__file__).parent
HEAVY = ("rclpy", "hmcvt_ros", "scipy", "yaml", "matplotlib", "click", "rosbags")


@pytest.fixture(scope="module")
def loaded():
    """Modules that a fresh interpreter holds after `import hmcvt_core`."""
    done = subprocess.run(
        [sys.executable, "-c", "import hmcvt_core, sys; print('\\n'.join(sys.modules))"],
        capture_output=True, text=True, check=True, cwd=SOURCE.parent, timeout=60)
    return set(done.stdout.split())


@pytest.mark.parametrize("name", HEAVY)
def test_import_leaves_out(loaded, name):
    assert "hmcvt_core.power_balance" in loaded
    assert name not in loaded


def test_core_never_mentions_ros():
    files = sorted(SOURCE.rglob("*.py"))
    assert len(files) > 20
    for file in files:
        text = file.read_text(encoding="utf-8")
        for word in ("rclpy", "hmcvt_ros", "_msgs"):
            assert word not in text, file


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


def test_modules_stay_small():
    for file in SOURCE.rglob("*.py"):
        assert len(file.read_text(encoding="utf-8").splitlines()) <= 400, file


def test_every_error_raised_on_purpose_is_one_line():
    assert str(hmcvt.InputError("a\nb\r\nc")) == "a b c"
    assert len(str(hmcvt.InputError("x" * 10_000))) == 1000
    assert issubclass(hmcvt.InputError, hmcvt.HmcvtError)
    assert issubclass(hmcvt.HmcvtError, ValueError)
