# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The registry of quantities: every entry is complete, and everything follows from it."""

import ast
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import CHANNELS, Transmission, observe
from hmcvt_core.files import bench
from hmcvt_core.physics.readings import READINGS
from hmcvt_core.transmission.quantities import PREDICTED, QUANTITIES, STORED
from hmcvt_tools.tables.raw import UNITS, choose_columns, import_table
from hmcvt_tools.tables.rules import KINDS, meaning_of

every_quantity = pytest.mark.parametrize("quantity", QUANTITIES, ids=lambda q: q.name)
READ_BY_METERS = ("temperature", "pressure", "power", "torque", "speed", "flow")
N = 6


def samples():
    """Bench samples with every column, in range, at points that a bench runs."""
    rng = np.random.default_rng(1)
    columns = {}
    for quantity in STORED:
        low, high = max(quantity.low, -1e8), min(quantity.high, 1e8)
        columns[quantity.name] = low + (high - low) * rng.uniform(0.5, 0.9, N)
    columns["displacement_ratio"] = np.linspace(-0.9, 0.8, N)
    columns["stamp"] = 1000.0 * np.arange(N)
    columns["load_torque"] = np.array([150.0, 300.0, 90.0, 200.0, 250.0, 120.0])
    columns["engine_speed"] = np.array([120.0, 200.0, 150.0, 90.0, 180.0, 210.0])
    columns["output_speed"] = 0.5 * columns["engine_speed"]
    return hmcvt.BenchSamples(**columns, source="simulated")


@every_quantity
def test_an_entry_is_complete(quantity):
    assert quantity.low < quantity.high
    assert quantity.unit and quantity.meaning
    assert quantity.kind in KINDS
    assert next(iter(UNITS[quantity.name])) == quantity.unit
    assert quantity.headings
    assert quantity.stored or not (quantity.required or quantity.channel)
    assert not (quantity.required and quantity.joint), "every message states it"


@every_quantity
def test_a_table_names_it(quantity):
    heading = f"{quantity.name.replace('_', ' ')} [{quantity.unit}]"
    assert meaning_of(heading).quantity == quantity.name


def test_names_are_those_of_the_columns_and_of_the_fields():
    names = [quantity.name for quantity in STORED]
    assert len(set(names)) == len(names)
    assert [field.name for field in fields(hmcvt.BenchSamples)][: len(names)] == names


def test_type_checkers_see_every_column():
    """The fields are made at run time; files/bench.py declares them under TYPE_CHECKING."""
    text = Path(bench.__file__).read_text(encoding="utf-8")
    classes = {
        node.name: node
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ClassDef)
    }
    declared = {
        line.target.id: (ast.unparse(line.annotation), line.value is None)
        for line in classes["_Columns"].body
        if isinstance(line, ast.AnnAssign)
    }
    expected = {
        quantity.name: ("Array", True) if quantity.required else ("Array | None", False)
        for quantity in STORED
    }
    assert list(declared.items()) == list(expected.items())


def test_every_column_is_read_from_the_csv_that_is_written(tmp_path):
    given = samples()
    hmcvt.write_bench(tmp_path / "bench.csv", given)
    header = (tmp_path / "bench.csv").read_text().splitlines()[0]
    assert header == ",".join(quantity.name for quantity in STORED)
    again = hmcvt.read_bench(tmp_path / "bench.csv")
    np.testing.assert_equal(again.columns, given.columns)


def test_every_column_is_imported_from_its_name_in_words(tmp_path):
    given = samples()
    path = tmp_path / "raw.csv"
    headings = [
        f"{quantity.name.replace('_', ' ')} [{quantity.unit}]" for quantity in STORED
    ]
    rows = np.stack(list(given.columns.values()), axis=1).tolist()
    lines = [",".join(map(repr, row)) for row in rows]
    path.write_text("\n".join([",".join(headings), *lines]))
    # Many call the torque of the output that of the load, so that this one is always asked.
    named = {"load_torque": "load torque [N m]"}
    table, proposal = choose_columns(path, named, guess=True, averaged=True)
    assert not proposal.questions
    found = import_table(table, proposal, averaged=True, unchecked=True).samples
    np.testing.assert_equal(found.columns, given.columns)


def test_every_channel_is_predicted_and_observed():
    names = [quantity.name for quantity in PREDICTED]
    assert names == list(READINGS) == [channel.name for channel in CHANNELS]
    assert names[0] == "efficiency", "the gap is measured in the first"
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    given = samples()
    assert list(model.readings_at(given.points)) == names
    assert [channel.name for channel in observe(given).channels] == names


def test_gauges_of_the_registry_are_refitted_where_they_are_read():
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    ungauged = len(Transmission(model).base)
    for quantity in PREDICTED:
        found = Transmission(model, [quantity.name]).base.names[ungauged:]
        gauge = quantity.gauge
        expected = ()
        if gauge is not None and not gauge.by_session:
            expected = (f"{quantity.name}_gain",)
            if gauge.zero:
                expected = (*expected, f"{quantity.name}_zero")
        assert found == expected


@every_quantity
@pytest.mark.parametrize("kind", READ_BY_METERS)
def test_a_word_of_its_own_names_no_other_quantity(quantity, kind):
    """Headings of others that need no word, as that of `pressure`, have to exclude it."""
    for word in quantity.words.split():
        found = meaning_of(f"{word} {kind}").quantity
        assert found in ("", quantity.name), f"{word} {kind}"
