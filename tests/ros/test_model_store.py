# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which model is in service, over refits, reverts, restarts and damage."""

import json
import shutil
from dataclasses import replace

import pytest
from ros_bench import adopted

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_core.physics.effects.sensor import EngineTorqueGain
from hmcvt_ros.model_store import ModelStore, proven
from hmcvt_ros.state_folder import keep_newest, next_name


@pytest.fixture
def base(paper_file):
    return hmcvt.load_model(paper_file)


def refit(store: ModelStore, leakage: float) -> str:
    return adopted(store, leakage).fingerprint


def test_reverts_in_the_order_of_refits(paper_file, base, tmp_path):
    store = ModelStore(paper_file, tmp_path)
    first, second = refit(store, 1e-12), refit(store, 2e-12)
    assert store.in_service.model.fingerprint == second
    assert store.revert().fingerprint == first
    again = ModelStore(paper_file, tmp_path)  # as a restart does
    assert again.in_service.model.fingerprint == first and again.complaint == ""
    third = refit(store, 3e-12)
    assert store.in_service.path.name == "0003.yaml"
    assert store.in_service.model.fingerprint == third
    assert [store.revert().fingerprint for _ in range(2)] == [first, base.fingerprint]
    assert store.in_service.path == paper_file.resolve()
    with pytest.raises(hmcvt.HmcvtError, match="none before"):
        store.revert()


def test_drift_counts_from_the_base_or_from_the_first_refit_of_an_example(
    paper_file, tmp_path
):
    example = ModelStore(paper_file, tmp_path / "a")  # it states no errors
    assert example.reference == paper_file.resolve()
    for leakage in (1e-12, 2e-12):
        refit(example, leakage)
        assert example.reference.name == "0001.yaml"
    identified = ModelStore(hmcvt.data_path("params/hm4.yaml"), tmp_path / "b")
    refit(identified, 1e-12)
    assert identified.reference == identified.base


def test_refit_of_another_model_file_is_not_taken_up(paper_file, base, tmp_path):
    refit(ModelStore(paper_file, tmp_path), 1e-12)
    other_file = tmp_path / "other.yaml"
    other = replace(base, parameters=replace(base.parameters, leakage=9e-12))
    hmcvt.save_model(other, other_file)
    store = ModelStore(other_file, tmp_path)
    assert store.in_service.model.fingerprint == other.fingerprint
    assert "another model_file" in store.complaint


def test_damaged_refit_falls_back_to_the_one_before(paper_file, base, tmp_path):
    store = ModelStore(paper_file, tmp_path)
    first = refit(store, 1e-12)
    refit(store, 2e-12)
    store.in_service.path.write_text("schema: hmcvt")
    again = ModelStore(paper_file, tmp_path)
    assert (
        again.in_service.model.fingerprint == first and "0002.yaml" in again.complaint
    )
    again.in_service.path.unlink()
    assert (
        ModelStore(paper_file, tmp_path).in_service.model.fingerprint
        == base.fingerprint
    )


def test_flipped_bits_of_the_state_are_noticed(paper_file, tmp_path):
    store = ModelStore(paper_file, tmp_path)
    refit(store, 1e-12)
    second = refit(store, 2e-12)
    state = tmp_path / "in_service.json"
    whole = state.read_bytes()
    told = 0
    for place in range(0, len(whole), 3):
        raw = bytearray(whole)
        raw[place] ^= 1 << place % 8
        state.write_bytes(raw)
        again = ModelStore(paper_file, tmp_path)
        same = again.in_service.model.fingerprint == second
        assert same == (again.complaint == ""), place
        told += not same
    assert told > 0.9 * len(whole) / 3


def test_state_of_version_0_1_is_taken_up(paper_file, base, tmp_path):
    store = ModelStore(paper_file, tmp_path)
    fingerprints = [refit(store, leakage) for leakage in (1e-12, 2e-12, 3e-12)]
    (tmp_path / "in_service.json").write_text(
        json.dumps(
            {
                "base": str(paper_file),
                "base_fingerprint": base.fingerprint,
                "in_service": ["0001.yaml", "0002.yaml", "0003.yaml"],
            }
        )
    )
    again = ModelStore(paper_file, tmp_path)
    assert (
        again.in_service.model.fingerprint == fingerprints[2] and again.complaint == ""
    )
    assert again.revert().fingerprint == fingerprints[1]
    shutil.copy(tmp_path / "models" / "0001.yaml", tmp_path / "models" / "0002.yaml")
    third = ModelStore(paper_file, tmp_path)
    assert third.in_service.model.fingerprint == fingerprints[0]
    assert "0002.yaml: is not what was written" in third.complaint


def test_model_that_cannot_be_gone_back_to_is_passed_over_and_told(
    paper_file, tmp_path
):
    store = ModelStore(paper_file, tmp_path)
    first = refit(store, 1e-12)
    refit(store, 2e-12)
    (tmp_path / "models" / "0002.yaml").unlink()
    with pytest.raises(hmcvt.InputError, match=r"0002\.yaml"):
        proven(store.promised)
    refit(store, 3e-12)
    assert store.revert().fingerprint == first
    assert (
        "0002.yaml" in store.complaint and "0001.yaml serves instead" in store.complaint
    )
    assert proven(store.promised).name == "0001.yaml"
    store.revert()
    assert store.complaint == ""


def test_refits_are_pruned_but_those_one_can_go_back_to(paper_file, base, tmp_path):
    store = ModelStore(paper_file, tmp_path)
    served = refit(store, 1e-12)
    for _ in range(60):  # written, and not adopted
        shutil.copy(tmp_path / "models" / "0001.yaml", store.new_path())
    for number in range(25):
        served = refit(store, 2e-12 + number * 1e-15)
    names = sorted(path.name for path in (tmp_path / "models").iterdir())
    assert names == [f"{number:04d}.yaml" for number in range(86 - 70 + 1, 87)]
    again = ModelStore(paper_file, tmp_path)
    assert again.in_service.model.fingerprint == served and again.complaint == ""
    for _ in range(20):
        last = again.revert()
    assert last.fingerprint == base.fingerprint
    assert again.new_path().name == "0087.yaml"


def test_published_formulas_are_not_served(paper_file, base, tmp_path):
    file = tmp_path / "published.yaml"
    hmcvt.save_model(replace(base, formulation="published"), file)
    with pytest.raises(
        hmcvt.InputError, match=r"published.yaml: formulation 'published' is not"
    ):
        ModelStore(file, tmp_path)
    store = ModelStore(paper_file, tmp_path)
    with pytest.raises(hmcvt.InputError, match="is not served"):
        store.adopt(file)
    assert store.in_service.model.fingerprint == base.fingerprint
    assert (
        ModelStore(paper_file, tmp_path).in_service.model.fingerprint
        == base.fingerprint
    )


def test_error_of_a_meter_is_not_served(base, tmp_path):
    file = tmp_path / "diagnosed.yaml"
    hmcvt.save_model(
        replace(base, effects=(EngineTorqueGain(-0.1), ChargePump(5.0))), file
    )
    served = ModelStore(file, tmp_path).in_service.model
    assert served.effects == (ChargePump(5.0),)
    assert hmcvt.load_model(file).efficiency(0.5, 150.0, 200.0) == pytest.approx(
        served.efficiency(0.5, 150.0, 200.0) / 0.9
    )


def test_numbers_rise_and_are_not_used_again(tmp_path):
    folder = tmp_path / "reports"
    for number in range(1, 13):
        path = next_name(folder, 3)
        assert path == folder / f"{number:04d}"
        path.with_suffix(".html").write_text("")
        path.with_suffix(".json").write_text("")
    (folder / "notes.txt").write_text("mine")
    keep_newest(folder, 2)
    assert sorted(path.name for path in folder.iterdir()) == [
        "0011.html",
        "0011.json",
        "0012.html",
        "0012.json",
        "notes.txt",
    ]
    assert next_name(folder, 3).name == "0013"
