# SPDX-License-Identifier: Apache-2.0
"""Seal a campaign: samples in one folder, label in another, a commitment that binds the two."""

from __future__ import annotations

import hashlib
import json
import re
import secrets
from dataclasses import dataclass
from pathlib import Path

from hmcvt_core.errors import InputError
from studies.blind.campaign import Campaign


@dataclass(frozen=True)
class SealedCampaign:
    """Files of a sealed campaign: samples and commitment to hand out, label to keep back."""

    bench: Path
    commitment: Path
    label: Path


def seal(campaign: Campaign, name: str, folder: Path, label_folder: Path) -> SealedCampaign:
    """Write `name`.csv and `name`.seal into `folder`, `name`.label.json into `label_folder`.

    The CSV holds contract columns only. The seal is the SHA-256 over the CSV's own SHA-256 and
    the label file; the salt lies inside the label file, so that guessing labels cannot break the
    seal. Raises InputError when the folders are one, a file exists already, or the name holds more
    than letters, digits, "-" and "_".
    """
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise InputError(f"name {name!r} may hold letters, digits, '-' and '_' only")
    if folder.resolve() == label_folder.resolve():
        raise InputError(f"samples and labels need two folders, both are {folder}")
    sealed = SealedCampaign(
        folder / f"{name}.csv", folder / f"{name}.seal", label_folder / f"{name}.label.json"
    )
    for path in (sealed.bench, sealed.commitment, sealed.label):
        if path.exists():
            raise InputError(f"{path} exists; a sealed campaign is never written over")
        path.parent.mkdir(parents=True, exist_ok=True)
    bench = _csv(campaign).encode()
    body = {"salt": secrets.token_hex(16), "label": campaign.label.to_mapping()}
    label = json.dumps(body, indent=1, sort_keys=True).encode()
    sealed.label.write_bytes(label)
    sealed.bench.write_bytes(bench)
    sealed.commitment.write_text(_commitment(bench, label) + "\n", encoding="ascii")
    return sealed


def open_seal(sealed: SealedCampaign) -> dict[str, object]:
    """Return the label (Label.to_mapping) of a sealed campaign.

    Raises InputError when the samples or the label were changed after sealing, or a file is
    missing.
    """
    try:
        bench, label = sealed.bench.read_bytes(), sealed.label.read_bytes()
        promised = sealed.commitment.read_text(encoding="ascii").strip()
    except OSError as error:
        raise InputError(f"{error.filename}: {error.strerror}") from error
    if not secrets.compare_digest(promised, _commitment(bench, label)):
        raise InputError(f"{sealed.commitment}: samples or label were changed after sealing")
    opened: dict[str, object] = json.loads(label)["label"]
    return opened


def _commitment(bench: bytes, label: bytes) -> str:
    return hashlib.sha256(hashlib.sha256(bench).digest() + label).hexdigest()


def _csv(campaign: Campaign) -> str:
    names = list(campaign.samples)
    rows = zip(*(campaign.samples[name] for name in names), strict=True)
    lines = [",".join(names)]
    lines += [",".join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"
