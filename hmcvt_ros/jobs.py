# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The heavy work of the node, a refit or a diagnosis, which runs in another process."""

import hashlib
import importlib
import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
import hmcvt_tools
from hmcvt_core.interface import (
    PAPER_EFFICIENCY_UNCERTAINTY,
    plain,
    refit,
    write_atomically,
)

from .bench_log import STATED, STATED_SESSION
from .model_store import Promised, proven, servable
from .state_folder import MODELS, PAGE_DATA, PAGES, next_name, require_regular


def with_proven(
    work: Callable[..., dict[str, Any]],
    promised: Promised,
    effects: str,
    effects_checksum: str,
    **options: Any,
) -> dict[str, Any]:
    """Do a job on the model in service, once that has proved to be what was put there.

    It is checked here rather than in the node, whose answers would wait for the files to be read.

    Args:
        work: one of the jobs below.
        promised: files of the model in service and of the base, with their fingerprints.
        effects: module or file with effects of the user; empty for none.
        effects_checksum: what `loaded_effects` gave for it at the start of the node.
        options: arguments of the job.

    Raises:
        HmcvtError: a file was changed; as of the job.
    """
    # This process has not loaded them.
    if loaded_effects(effects) != effects_checksum:
        raise hmcvt.InputError(
            f"effects_file: {effects} was changed after the start of the node, which computes by "
            "what it was; start the node again"
        )
    return work(model=proven(promised), **options)


def loaded_effects(source: str) -> str:
    """Load effects of the user, and return the checksum of their file; empty for no effects.

    Args:
        source: module or Python file; empty for none.

    Raises:
        InputError: as of `hmcvt_core.load_effects`.
    """
    if not source:
        return ""
    hmcvt.load_effects(source)
    file = source
    if not source.endswith(".py"):
        file = str(importlib.import_module(source).__file__)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


def reidentify(
    samples: Path,
    model: Path,
    base: Path,
    seed: int,
    max_drift: float,
    max_change: float,
    accepted: Path,
    output: Path,
    candidates: Path,
    min_samples: int,
    noise: float,
) -> dict[str, Any]:
    """Refit a model to samples.

    Args:
        samples: bench file.
        model: parameter file of the model in service.
        base: parameter file of the model that the refits began with.
        seed: seed of the random numbers.
        max_drift: largest mean difference to `base` within the domain [-].
        max_change: largest change within the domain that needs no person [-].
        accepted: parameter file of the last model that a person decided on.
        output: file for the refit.
        candidates: folder for the refit instead, when it must not serve.
        min_samples: fewest samples that are accepted.
        noise: standard deviation of the efficiency of samples that state none [-]; 0 for the
            paper's.

    Returns:
        Sample count, error (mean |predicted - measured| / measured) before and after, parameters
        with standard errors, which samples are set aside, what is kept from the model in service,
        what the samples leave open, by how much answers change, and the comparison on samples held
        back; `model` (the fingerprint), `file` and `doubt` of the refit (why a person has to decide
        on it, None where none has to), or `refused` and `candidate` when something speaks against
        it.

    Raises:
        HmcvtError: the samples are too few, or determine nothing.
    """
    bench = bench_of(samples, noise)
    if len(bench) < min_samples:
        raise hmcvt.InputError(
            f"{bench.source}: {len(bench)} samples; reidentify_min_samples "
            f"= {min_samples}"
        )
    result = refit(
        bench,
        hmcvt.load_model(model),
        hmcvt.load_model(base),
        seed=seed,
        max_drift=max_drift,
        accepted=hmcvt.load_model(accepted),
        max_change=max_change,
    )
    # Drift and warnings go into the file: they hold as long as the model serves.
    provenance = {
        **result.model.provenance,
        "drift": float(f"{result.drift:.6g}"),
        "warnings": list(result.warnings),
    }
    fitted = replace(result.model, provenance=provenance)
    held_back = None
    if result.held_back is not None:
        held_back = asdict(result.held_back)
    answer = {
        "samples": len(bench),
        "source": bench.source,
        "error_before": result.error_before,
        "error_after": result.error_after,
        "parameters": fitted.to_mapping()["parameters"],
        "warnings": [*result.warnings, *left_out(bench)],
        "set_aside": result.set_aside,
        "kept": result.kept,
        "largest_change": result.largest_change,
        "drift": result.drift,
        "held_back": held_back,
    }
    if result.refused:
        return {**answer, **_candidate(fitted, candidates, result.refused)}
    hmcvt.save_model(fitted, output)
    return {
        **answer,
        # The fingerprint of the model as a restart would read it, to the last digit.
        "model": servable(output).fingerprint,
        "file": str(output),
        "doubt": result.doubt or None,
    }


def _candidate(
    fitted: hmcvt.EfficiencyModel, folder: Path, refused: str
) -> dict[str, Any]:
    """Keep a refit that must not serve; return the reason and where it is kept."""
    try:
        path = next_name(folder, MODELS).with_suffix(".yaml")
        hmcvt.save_model(fitted, path)
    except OSError as error:
        return {"candidate": None, "refused": f"{refused}; it is not kept: {error}"}
    equal = _equal_before(path)
    if equal is not None:
        path.unlink()
        path = equal
    return {"candidate": str(path), "refused": f"{refused}; it is kept as {path}"}


def _equal_before(path: Path) -> Path | None:
    """Return the file numbered before another if it holds an equal model."""
    before = path.with_name(f"{int(path.stem) - 1:04d}.yaml")
    try:
        same = servable(before).fingerprint == servable(path).fingerprint
    except hmcvt.HmcvtError:
        return None
    return before if same else None


def bench_of(path: Path, noise: float = 0.0) -> hmcvt.BenchSamples:
    """Read bench samples; those of the log may state their standard deviation.

    Args:
        path: bench file.
        noise: standard deviation of the efficiency of the samples that state none, where others
            do [-]; 0 for the paper's.

    Raises:
        InputError: the file is wrong, or a stated standard deviation is.
    """
    require_regular(path)
    bench = _with_channels(hmcvt.read_bench(path))
    cells = bench.extra.get("stated_std", ())
    if bench.efficiency_std is not None or not any(cells):
        return bench
    default = PAPER_EFFICIENCY_UNCERTAINTY * bench.efficiency
    if noise:
        default = np.full(len(bench), noise)
    values = default.tolist()
    for i, cell in enumerate(cells):
        if cell:
            values[i] = _number(cell, f"{bench.label(i)}: stated_std")
    return replace(bench, efficiency_std=np.array(values))


def _with_channels(bench: hmcvt.BenchSamples) -> hmcvt.BenchSamples:
    """Return samples of the log with the quantities that each of them states."""
    channels: dict[str, Any] = {}
    for column, name in STATED.items():
        cells = bench.extra.get(column, ())
        if name != "efficiency_std" and cells and all(cells):
            values = [
                _number(cell, f"{bench.label(i)}: {column}")
                for i, cell in enumerate(cells)
            ]
            channels[name] = np.array(values)
    extra = dict(bench.extra)
    sessions = extra.get(STATED_SESSION, ())
    if sessions and all(sessions):
        extra["session"] = sessions
    return replace(bench, **channels, extra=extra)


def left_out(bench: hmcvt.BenchSamples) -> list[str]:
    """Return which quantities are not used because some samples of the log lack them."""
    sentences = []
    for column in (*STATED, STATED_SESSION):
        cells = bench.extra.get(column, ())
        stated = sum(map(bool, cells))
        if column != "stated_std" and 0 < stated < len(cells):
            name = column.removeprefix("stated_")
            sentences.append(
                f"{name} is left out: {stated} of {len(cells)} samples state it"
            )
    return sentences


def _number(cell: str, where: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise hmcvt.InputError(f"{where} = {cell!r} is no number") from None


def diagnose(
    samples: Path,
    model: Path,
    seed: int,
    reports: Path,
    noise: float = 0.0,
    baseline: str = "",
) -> dict[str, Any]:
    """Diagnose the gap between a model and samples.

    Args:
        samples: bench file.
        model: parameter file of the model in service.
        seed: seed of the random numbers.
        reports: folder for the page of the diagnosis.
        noise: standard deviation of the efficiency [-]; 0 for what the samples state.
        baseline: bench file of the sound transmission, which is held; empty for none.

    Returns:
        The object of `hmcvt diagnose --json`; `left_out`: which quantities are not used because
        some samples lack them; and `report`: path of the page, None with a reason in `report_error`
        when it cannot be written.
    """
    sound = None
    if baseline:
        sound = bench_of(Path(baseline), noise)
    bench = bench_of(samples, noise)
    diagnosis = hmcvt.diagnose(
        hmcvt.load_model(model),
        bench,
        noise=noise or None,
        seed=seed,
        baseline=sound,
    )
    answer = {**diagnosis.to_dict(), "left_out": left_out(bench)}
    try:
        path = next_name(reports, PAGES, PAGE_DATA).with_suffix(".html")
        try:
            # First, for it takes longest: a job that is begun again meanwhile leaves nothing.
            hmcvt_tools.write_html(diagnosis, path)
        finally:
            data = json.dumps(plain(answer)) + "\n"
            write_atomically(path.with_suffix(".json"), data)
    except Exception as error:
        # Of any kind, such as a full disk or no Jinja2: the answer is worth more than the page.
        reason = str(error)
        if isinstance(error, ImportError):
            reason = f'{reason}: the page needs pip install ".[report]"'
        return {**answer, "report": None, "report_error": reason}
    return {**answer, "report": str(path)}
