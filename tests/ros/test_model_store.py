# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which model is in service, over refits, reverts, restarts and damage."""

import json
import os
from dataclasses import replace

import pytest
from ros_bench import adopted

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_core.physics.effects.sensor import EngineTorqueGain
from hmcvt_ros import model_store, state_folder
from hmcvt_ros.model_store import ModelStore, proven
from hmcvt_ros.state_folder import PAGE_DATA, PAGES, next_name


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


def test_huge_state_is_not_read(paper_file, tmp_path):
    with (tmp_path / "in_service.json").open("wb") as file:
        file.truncate(1 << 40)  # a sparse file of 1 TB
    assert "allowed are 1048576" in ModelStore(paper_file, tmp_path).complaint


@pytest.mark.parametrize("key", ["checksum", "accepted", "fingerprints"])
def test_state_without_its_checksum_is_not_taken_up_silently(
    paper_file, base, tmp_path, key
):
    refit(ModelStore(paper_file, tmp_path), 1e-12)
    path = tmp_path / "in_service.json"
    state = json.loads(path.read_text())
    del state[key]
    path.write_text(json.dumps(state))
    again = ModelStore(paper_file, tmp_path)
    assert again.in_service.model.fingerprint == base.fingerprint
    assert "cannot be read or is damaged" in again.complaint
    assert "its checksum is missing or does not match" in again.complaint


def test_state_that_states_no_laws_of_effects_is_taken_up(paper_file, tmp_path):
    first = refit(ModelStore(paper_file, tmp_path), 1e-12)
    path = tmp_path / "in_service.json"
    state = json.loads(path.read_text())
    for key in ("laws", "base_laws", "checksum"):
        del state[key]
    state["checksum"] = model_store._checksum(state)
    path.write_text(json.dumps(state))
    again = ModelStore(paper_file, tmp_path, "0f")
    assert (again.in_service.model.fingerprint, again.complaint) == (first, "")


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


def start_often(folder):
    """Start in a state folder so often that all that is in it is old."""
    for _ in range(state_folder.KEPT_STARTS + 1):
        state_folder.StateFolder(folder).close()


def test_all_recent_refits_can_be_reverted(paper_file, base, tmp_path, monkeypatch):
    monkeypatch.setattr(model_store, "MAX_VERSIONS", 25)
    store = ModelStore(paper_file, tmp_path)
    served = [refit(store, 1e-12 + number * 1e-15) for number in range(2)]
    start_often(tmp_path)
    served += [refit(store, 1e-12 + number * 1e-15) for number in range(2, 25)]
    # What is old gives way, but for the first, from which the drift counts.
    served.append(refit(store, 8e-12))
    with pytest.raises(hmcvt.HmcvtError, match="25 models were put into service"):
        refit(store, 9e-12)
    again = ModelStore(paper_file, tmp_path)
    assert again.in_service.model.fingerprint == served[-1] and again.complaint == ""
    assert again.reference.name == "0001.yaml"
    back = [again.revert().fingerprint for _ in range(25)]
    assert back == [*served[-2:1:-1], served[0], base.fingerprint]


def test_equal_refit_is_no_new_version(paper_file, base, tmp_path):
    store = ModelStore(paper_file, tmp_path)
    first = refit(store, 1e-12)
    for _ in range(30):
        assert refit(store, 1e-12) == first
    assert [path.name for path in (tmp_path / "models").iterdir()] == ["0001.yaml"]
    assert store.revert().fingerprint == base.fingerprint


def test_equal_refit_that_covers_more_is_a_new_version(paper_file, tmp_path):
    store = ModelStore(paper_file, tmp_path)
    refit(store, 1e-12)
    model = store.in_service.model
    wide = hmcvt.Domain((-1.0, 1.0), (80.0, 230.0), (10.0, 400.0))
    for domain in (wide, replace(wide, oil_temperature=(50.0, 70.0))):
        path = store.new_path()
        hmcvt.save_model(replace(model, domain=domain), path)
        assert store.adopt(path).fingerprint == model.fingerprint
        assert store.in_service.path == path
        assert store.in_service.model.domain == domain


def test_what_a_person_accepted_last_is_remembered(tmp_path):
    path = hmcvt.data_path("params/hm4.yaml")
    store = ModelStore(path, tmp_path)
    refit(store, 1e-12)
    assert store.accepted == store.base
    model, file = store.in_service.model, store.new_path()
    parameters = replace(model.parameters, leakage=2e-12)
    hmcvt.save_model(replace(model, parameters=parameters), file)
    store.adopt(file, accepted=True)
    refit(store, 3e-12)
    assert ModelStore(path, tmp_path).accepted == file
    store.revert()
    store.revert()
    assert store.accepted == store.base


def test_first_refit_of_an_example_counts_as_accepted(paper_file, tmp_path):
    store = ModelStore(paper_file, tmp_path)
    refit(store, 1e-12)
    refit(store, 2e-12)
    assert store.accepted.name == "0001.yaml"


def test_links_are_not_followed(paper_file, tmp_path):
    store = ModelStore(paper_file, tmp_path / "state")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    refit(store, 1e-12)
    (tmp_path / "state" / "models").rename(tmp_path / "away")
    (tmp_path / "state" / "models").symlink_to(elsewhere)
    with pytest.raises(OSError, match="is a link"):
        store.new_path()
    assert list(elsewhere.iterdir()) == []


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
        path = next_name(folder, PAGES, PAGE_DATA)
        assert path == folder / f"{number:04d}"
        path.with_suffix(".html").write_text("<!DOCTYPE html>")
    (folder / "0099.txt").write_text("mine")
    assert next_name(folder, PAGES).name == "0100"


def test_only_old_files_that_the_node_wrote_give_way(tmp_path, monkeypatch):
    monkeypatch.setattr(state_folder, "KEPT_FILES", 10)
    for number in range(1, 11):
        (tmp_path / f"{number:04d}.html").write_text("<!DOCTYPE html>")
    os.utime(tmp_path / "0001.html", (0.0, 0.0))  # by a clock of 1970
    with pytest.raises(OSError, match="holds 10 files like it"):
        next_name(tmp_path, PAGES)
    mine = tmp_path / "0001.html"
    mine.write_text("mine")
    target = tmp_path / "target"
    target.write_text("<!DOCTYPE html>")
    link = tmp_path / "0002.html"
    link.unlink()
    link.symlink_to(target)
    (tmp_path / "0001.json").touch()
    start_often(tmp_path)
    assert next_name(tmp_path, PAGES).name == "0011"
    assert mine.read_text() == "mine" and link.is_symlink() and target.exists()
    assert (tmp_path / "0001.json").exists() and (tmp_path / "0004.html").exists()


def test_files_that_are_too_large_together_give_way(tmp_path, monkeypatch):
    monkeypatch.setattr(state_folder, "KEPT_BYTES", 100_000)
    for number in range(1, 4):
        path = tmp_path / f"{number:04d}.html"
        path.write_text("<!DOCTYPE html>".ljust(40_000))
    start_often(tmp_path)
    next_name(tmp_path, PAGES)
    assert sorted(path.name for path in tmp_path.glob("*.html")) == [
        "0002.html",
        "0003.html",
    ]
