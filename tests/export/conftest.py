# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Exported C of the shipped parameter files, built once."""

import pytest

import hmcvt_core as hmcvt
import hmcvt_tools
from export.c_library import Library, needs_compiler

FILES = ("hm4", "hydrostatic", "output_coupled", "tractor")
STAGES = (
    ("hm4", "HM4"),
    ("hydrostatic", "H"),
    ("output_coupled", "forward"),
    ("output_coupled", "reverse"),
    ("tractor", "H0"),
    ("tractor", "HM1"),
    ("tractor", "HM2"),
    ("tractor", "HM3"),
    ("tractor", "HM4"),
)


class Exported:
    """A shipped model and its C."""

    def __init__(self, name, folder, precision):
        self.model = hmcvt.load_model(hmcvt.data_path(f"params/{name}.yaml"))
        hmcvt_tools.export_c(self.model, folder, precision)
        self.folder = folder
        self.library = Library(folder, self.model, precision)

    def number(self, stage):
        return list(self.model.stages).index(stage)


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """Return a function that gives a shipped model as C, built once."""
    built = {}

    def build(name, precision="double"):
        key = name, precision
        if key not in built:
            folder = tmp_path_factory.mktemp("c") / f"{name}_{precision}"
            built[key] = Exported(name, folder, precision)
        return built[key]

    return build


def pytest_collection_modifyitems(items):
    """Skip what builds C where there is no compiler."""
    for item in items:
        if "exported" in getattr(item, "fixturenames", ()):
            item.add_marker(needs_compiler)
