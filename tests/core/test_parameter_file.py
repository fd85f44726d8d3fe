# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Parameter files: round trip, refusal by the name of the field, and damage of every field."""

import copy
import dataclasses
import math

import numpy as np
import pytest
import yaml

import hmcvt_core as hmcvt
from hmcvt_core.model.parameter_file import _from_mapping

from .conftest import assert_refused

STROKES = np.linspace(-1.0, 1.0, 21)


@pytest.fixture
def saved(model, tmp_path):
    path = tmp_path / "model.yaml"
    hmcvt.save_model(model, path)
    return path


def edited(path, change):
    """Change the file as a person would: without its checksum."""
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    del data["checksum"]
    change(data)
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


def test_round_trip(model, saved):
    again = hmcvt.load_model(saved)
    assert again.parameters == model.parameters
    assert again.standard_errors == model.standard_errors
    assert again.domain == model.domain
    assert again.provenance == model.provenance
    assert again.formulation == model.formulation
    assert again.fingerprint == model.fingerprint
    assert again.domain.oil_temperature is None
    np.testing.assert_allclose(
        again.correlation, model.correlation, atol=1e-6
    )  # six digits
    np.testing.assert_array_equal(
        again.efficiency(STROKES, 120.0, 180.0), model.efficiency(STROKES, 120.0, 180.0)
    )
    assert again.to_mapping() == model.to_mapping()


def test_what_was_there_is_kept(model, saved, tmp_path):
    first = saved.read_bytes()
    other = dataclasses.replace(
        model, parameters=dataclasses.replace(model.parameters, leakage=1e-12)
    )
    hmcvt.save_model(other, saved)
    assert (tmp_path / "model.previous-1.yaml").read_bytes() == first
    saved.write_bytes(b"notes of mine\xff")
    hmcvt.save_model(model, saved)
    assert (tmp_path / "model.previous-2.yaml").read_bytes() == b"notes of mine\xff"
    assert hmcvt.load_model(saved).fingerprint == model.fingerprint
    assert len(list(tmp_path.iterdir())) == 3


def test_the_same_model_again_is_no_other_version(model, saved, tmp_path):
    later = {**model.provenance, "date": "2999-01-01T00:00:00Z"}
    hmcvt.save_model(dataclasses.replace(model, provenance=later), saved)
    assert [path.name for path in tmp_path.iterdir()] == ["model.yaml"]
    assert hmcvt.load_model(saved).provenance == later
    hmcvt.save_model(
        dataclasses.replace(model, provenance={**later, "data": "b.csv"}), saved
    )
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("value: 0.", "value: 0.1"),
        ("transmission:", "1: one\ntransmission:"),  # what was never written
    ],
)
def test_changed_text_is_noticed(saved, old, new):
    text = saved.read_text(encoding="utf-8")
    assert old in text
    saved.write_text(text.replace(old, new, 1), encoding="utf-8")
    assert_refused(
        hmcvt.load_model,
        saved,
        r"checksum does not match: the file is damaged or was "
        r"edited; .*remove",
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "formulation:",
            "bomb: &a [x, x]\nformulation:",
            r"not YAML of a parameter file at line 2: 'a' is an alias or the anchor of one",
        ),
        ("formulation:", "bomb: *a\nformulation:", r"at line 2: 'a' is an alias"),
        (
            "transmission:",
            "list: &list [*list]\ntransmission:",
            r"at line \d+: 'list' is an alias",
        ),
        (
            "formulation:",
            "formulation: " + "[" * 200_000 + "\nformulation:",  # libyaml ends Python
            r"not YAML of a parameter file at line 2: more than 20 levels",
        ),
        (
            "schema:",
            "tuning: 1\nschema:",
            r"tuning at line 1 is not known; there is schema, checksum",
        ),
        (
            "  leakage: {",
            "  leakage: {vlaue: 1.0, ",
            r"parameters\.leakage\.vlaue at line 4 is not known; "
            "there is value, unit, standard_error",
        ),
        (
            "  leakage: {",
            "  leakage: {value: 1.0e-12, ",
            r"value at line 4 stands there twice",
        ),
        (
            "  leakage: {",
            "  leakage: {<<: {value: 1.0e-12}, ",
            r"at line 4: '<<' merges mappings",
        ),
        (
            "        member: carrier",
            "        member: carrier\n        ratio: 2",
            r"transmission\.stages\.HM4\.mechanical\.ratio at line \d+ is not known; there is gear",
        ),
    ],
)
def test_what_a_parameter_file_never_holds_is_refused_with_its_line(
    saved, old, new, message
):
    text = "".join(
        line
        for line in saved.read_text(encoding="utf-8").splitlines(keepends=True)
        if not line.startswith("checksum")
    )
    assert old in text
    saved.write_text(text.replace(old, new, 1), encoding="utf-8")
    assert_refused(hmcvt.load_model, saved, message)


def test_numbers_as_people_write_them(saved):
    # YAML 1.1 reads 3e-11 as text.
    text = edited(saved, lambda data: data["parameters"]["leakage"].update(value=1.0))
    text.write_text(
        text.read_text(encoding="utf-8").replace("value: 1.0", "value: 3e-11"),
        encoding="utf-8",
    )
    assert hmcvt.load_model(saved).parameters.leakage == 3e-11


def put(*path):
    """Return a change that sets the last item of `path` at the place the others lead to."""
    *place, key, value = path

    def change(data):
        for step in place:
            data = data[step]
        if value is KeyError:
            del data[key]
        else:
            data[key] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            put("schema", "hmcvt-model/9"),
            r"schema = 'hmcvt-model/9'; this version reads 'hmcvt-model/",
        ),
        (
            put("formulation", "magic"),
            r"formulation = 'magic'; there is power_balance, published",
        ),
        (put("formulation", KeyError), r"formulation is missing"),
        (put("parameters", KeyError), r"parameters is missing"),
        (put("parameters", "leakage", KeyError), r"parameters\.leakage is missing"),
        (
            put("parameters", "leakage", "value", KeyError),
            r"parameters\.leakage\.value is missing",
        ),
        (
            put("parameters", "leakage", "value", math.nan),
            r"parameters\.leakage\.value = nan is not",
        ),
        (
            put("parameters", "leakage", "value", "much"),
            r"parameters\.leakage\.value = 'much' is not",
        ),
        (
            put("parameters", "leakage", "value", True),
            r"parameters\.leakage\.value = True is not",
        ),
        (
            put("parameters", "leakage", "value", 3.0),
            r"parameters: leakage = 3 is outside 1e-16 to 1e-08 m3/\(s Pa\)",
        ),
        (
            put("parameters", "leakage", "unit", "l/(min bar)"),
            r"parameters\.leakage\.unit = 'l/\(min bar\)'; needs 'm3/\(s Pa\)'",
        ),
        (
            put("parameters", "pump_damping", "standard_error", -1.0),
            r"pump_damping\.standard_error = -1\.0 is not a finite number of at least 0",
        ),
        *(
            (
                put("correlation", *wrong),
                r"correlation = .* is not a 3 x 3 matrix of -1 to 1 that is "
                r"symmetric, 1 on the diagonal, without a negative eigenvalue",
            )
            for wrong in (
                ([[1.0, 0.0], [0.0, 1.0]],),
                (0, 1, 0.5),
                (0, 0, 0.0),
                (0, 1, 2.0),
                ([[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]],),
            )
        ),
        (
            put("transmission", "stages", "HM4", "pump", "direction", -1),
            r"pump\.direction = -1 is not allowed; allowed: 1: give the motor path",
        ),
        (
            put("domain", "engine_speed", [2.0]),
            r"domain\.engine_speed = \[2\.0\] is not \[low, high\]",
        ),
        (
            put("domain", "oil_temperature", [90.0, 40.0]),
            r"domain\.oil_temperature = \[90\.0, 40\.0\]: needs two rising numbers",
        ),
        (put("effects", "none"), r"effects = 'none' is not a list"),
        (
            put("effects", [{"effect": "magic"}]),
            r"effects\[0\]: effect = 'magic'.* is not known;",
        ),
        (
            put("effects", ["charge_pump"]),
            r"effects\[0\] = 'charge_pump' is not a mapping",
        ),
        (put("transmission", KeyError), r"transmission is missing"),
        (
            put("transmission", "gear_pairs", "2", KeyError),
            r"gear_pairs\.2 is missing; there is 11,",
        ),
    ],
)
def test_wrong_field_is_named(saved, change, message):
    assert_refused(hmcvt.load_model, edited(saved, change), message)


def test_number_for_the_name_of_a_gear_pair_is_the_same_file(saved, model):
    text = saved.read_text(encoding="utf-8")
    assert "'2': 0.969" in text
    saved.write_text(text.replace("'2': 0.969", "2: 0.969"), encoding="utf-8")
    assert hmcvt.load_model(saved).fingerprint == model.fingerprint


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"holds no mapping; is it empty or cut off\?"),
        (b"- 1\n- 2\n", r"holds no mapping"),
        (b"schema: [1,\n  b: }", r"not YAML at line 2: "),
        (b"schema: x\n\ty: 1\n", r"not YAML at line 2: "),
        (b"\x00\x01", r"not YAML: unacceptable character #x0000"),
        (bytes(range(256)), r"not UTF-8 text at byte 128"),
        (b"schema: 2020-13-45", r"not YAML: month must be in 1\.\.12"),
        (b"schema: " + b"9" * 5000, r"not YAML: Exceeds the limit"),
        (b"[" * 5000, r"not YAML"),
        (b"!!python/object:os.system {}", r"at line 1: 'tag:.*:os\.system' is a tag"),
        (
            b"schema: !!bool x",
            r"file at line 1: 'tag:yaml.org,2002:bool' is a tag: write the value",
        ),
        (b"schema: " + b"x" * 5000, r"schema = 'x+ \.\.\.$"),
        (b"#" * 5_000_000, r"wrong\.yaml: larger than 1 MiB, not a parameter file"),
    ],
)
@pytest.mark.parametrize("load", [hmcvt.load_model, hmcvt.load_stage])
def test_wrong_file_is_named(tmp_path, load, content, message):
    path = tmp_path / "wrong.yaml"
    path.write_bytes(content)
    assert_refused(load, path, message)


def test_cut_at_any_byte_is_refused(model, tmp_path):
    bare = hmcvt.EfficiencyModel(
        model.stage, model.parameters
    )  # short, for the sake of time
    path = tmp_path / "model.yaml"
    hmcvt.save_model(bare, path)
    whole = path.read_bytes()
    assert whole.endswith(b"ring\n")
    for length in range(len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(hmcvt.InputError) as caught:
            hmcvt.load_model(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert len(str(caught.value).splitlines()) == 1
    path.write_bytes(whole[:-1])
    assert hmcvt.load_model(path).to_mapping() == bare.to_mapping()


JUNK = [
    None,
    True,
    -1,
    0,
    math.inf,
    math.nan,
    "x",
    "",
    [],
    {},
    [1],
    [[2, 3]],
    {"a": 1},
    [None],
    1e-300,
    10**400,
    {1: 2},
    [{}],
    KeyError,
]


def places(data, path=()):
    """Every place in nested lists and mappings."""
    if path:
        yield path
    items = (
        data.items()
        if isinstance(data, dict)
        else enumerate(data)
        if isinstance(data, list)
        else ()
    )
    for key, value in items:
        yield from places(value, (*path, key))


@pytest.mark.parametrize(
    ("whole", "read", "sound", "least"),
    [
        (
            hmcvt.load_model(hmcvt.data_path("params/hm4.yaml")).to_mapping()
            | {
                "effects": [
                    {"effect": "charge_pump", "parameters": {"torque": {"value": 1.0}}}
                ]
            },
            _from_mapping,
            lambda model: (
                0.0 < model.efficiency(0.5, 120.0, 180.0) < 1.0 and model.to_mapping()
            ),
            500,
        ),
        (
            yaml.safe_load(hmcvt.data_path("params/transmission.yaml").read_bytes()),
            hmcvt.Stage.from_mapping,
            lambda stage: stage.mechanical_speed_ratio > 0.0,
            200,
        ),
    ],
    ids=["model", "transmission"],
)
def test_damage_of_any_field_is_an_input_error_or_harmless(whole, read, sound, least):
    """Every field replaced by every kind of junk."""
    assert sound(read(whole))
    refused = 0
    for place in places(whole):
        data = copy.deepcopy(whole)
        for junk in JUNK:  # its last one leaves the field out
            put(*place, junk)(data)
            try:
                found = read(data)
            except hmcvt.InputError:
                refused += 1
            else:
                assert sound(found)
    assert refused > least
