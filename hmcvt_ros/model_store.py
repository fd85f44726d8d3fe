# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The models of a node: the one it starts from, those refitted, and the one in service.

    <state folder>/models/0001.yaml ...   every refitted model, never overwritten
    <state folder>/in_service.json        the models put into service one after the other

The second file is replaced as a whole, so that a crash at any moment leaves the model before or
the one after in service. It has a checksum and names the fingerprints of the models: a model that
is not what was put into service is not served, and the one before it is.

An effect of the user has its laws in `effects_file`. The second file states by which of them a
model was put into service, so that a start with an edited file is noticed.
"""

import hashlib
import json
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

from hmcvt_core import EfficiencyModel, HmcvtError, InputError, load_model
from hmcvt_core.interface import write_atomically

from .state_folder import (
    KEPT_FILES,
    KEPT_STARTS,
    MODELS,
    is_old,
    next_name,
    read_small,
    require_plain_path,
    require_regular,
)

MAX_VERSIONS = KEPT_FILES // 2
"""Models that can be reverted one after the other."""

Promised = tuple[tuple[Path, str], ...]
"""Parameter files, each with the fingerprint that it must have."""


class _Version(NamedTuple):
    """A model that was put into service.

    Attributes:
        name: name of its parameter file.
        fingerprint: its fingerprint; '' where unknown.
        accepted: whether a person decided on it.
        laws: checksum of the file with the effects of the user; '' where it has none of them, or
            where that is unknown.
    """

    name: str
    fingerprint: str
    accepted: bool = False
    laws: str = ""


_Stack = list[_Version]
"""Models put into service one after the other; the last is in service."""


class InService(NamedTuple):
    """A model without errors of meters, its parameter file, and since when it serves (UTC)."""

    model: EfficiencyModel
    path: Path
    since: str


@dataclass(frozen=True)
class _Selection:
    """A model to serve.

    Attributes:
        stack: models put into service, this one last.
        model: model itself.
        complaint: why it is not the last model put into service, or answers otherwise than it
            did; empty when it is.
    """

    stack: _Stack
    model: EfficiencyModel
    complaint: str = ""


class ModelStore:
    """Which model is in service, and the way back.

    One thread at a time may change it; others may read `in_service` meanwhile.

    Attributes:
        base: parameter file that the node was given.
        in_service: model in service.
        complaint: why it is not the last model put into service, or answers otherwise than it
            did; empty when it is.
    """

    def __init__(self, base: Path, folder: Path, effects_checksum: str = "") -> None:
        """Take up the state of a node.

        Args:
            base: parameter file that the node starts from.
            folder: holds the state.
            effects_checksum: that of the file with the effects of the user; empty without one.

        Raises:
            InputError: the file `base` is missing, damaged or not to be served.
        """
        self.base = base.resolve()
        self.complaint = ""
        self._models = folder / "models"
        self._state = folder / "in_service.json"
        self._effects_checksum = effects_checksum
        self._base_model = servable(base)
        self._base_laws = self._laws_of(self._base_model)
        selection = self._newest_intact(self._resumed())
        self._stack = selection.stack
        self.complaint = self.complaint or selection.complaint
        self.in_service = self._serving(selection)

    def new_path(self) -> Path:
        """Return a free name for a refitted model; remove old refits that cannot be reverted to.

        Raises:
            OSError: the folder is a link, cannot be created, or is full.
        """
        names = [version.name for version in self._stack]
        return next_name(self._models, MODELS, spared=names).with_suffix(".yaml")

    def adopt(
        self,
        path: Path,
        fingerprint: str = "",
        instead_of: Path | None = None,
        accepted: bool = False,
    ) -> EfficiencyModel:
        """Put a model written under `new_path` into service.

        A model equal to the one in service is no new version: its file is removed.

        Args:
            path: parameter file of the model.
            fingerprint: fingerprint that it must have; any when left out.
            instead_of: parameter file that must be in service; any when left out.
            accepted: whether a person decided on it.

        Raises:
            HmcvtError: another is in service, or too many were put into service lately.
            InputError: the file is damaged or not to be served; the model before stays.
            OSError: the state cannot be written; the model before stays.
        """
        if instead_of not in (None, self.in_service.path):
            raise HmcvtError(
                "the model in service changed meanwhile, and the refit was "
                "compared with the one before; call ~/reidentify again"
            )
        model = _with_fingerprint(path, fingerprint)
        if self._is_in_service(model):
            if path != self.in_service.path:
                path.unlink()
            return self._confirmed()
        # The first refit of an example identifies the unit: nothing was known of it before.
        first_of_example = not self._stack and not self._base_model.standard_errors
        version = _Version(
            path.name,
            model.fingerprint,
            accepted or first_of_example,
            self._laws_of(model),
        )
        stack = [*self._with_room(), version]
        return self._commit(_Selection(stack, model))

    def revert(self) -> EfficiencyModel:
        """Put the model before into service, or the newest before it that is intact.

        Raises:
            HmcvtError: there is none.
            OSError: the state cannot be written; nothing changes.
        """
        if not self._stack:
            raise HmcvtError(
                "the model in service is the one of model_file; there is none before"
            )
        return self._commit(self._newest_intact(self._stack[:-1]))

    @property
    def promised(self) -> Promised:
        """The parameter file in service, then that of the base, with their fingerprints."""
        return (
            (self.in_service.path, self.in_service.model.fingerprint),
            (self.base, self._base_model.fingerprint),
        )

    @property
    def reference(self) -> Path:
        """File of the model from which drift counts: the base, or the first refit of an example.

        A base that states no errors was not identified from this unit.
        """
        if self._base_model.standard_errors:
            return self.base
        return self._path(self._stack[:1])

    @property
    def accepted(self) -> Path:
        """File of the last model that a person decided on: the base where there is none."""
        for version in reversed(self._stack):
            if version.accepted:
                return self._models / version.name
        return self.base

    def _is_in_service(self, model: EfficiencyModel) -> bool:
        """Whether a model answers as the one in service does, over the same domain."""
        served = self.in_service.model
        return model.fingerprint == served.fingerprint and model.domain == served.domain

    def _with_room(self) -> _Stack:
        """Return the models put into service, with room for one more.

        Raises:
            HmcvtError: there are too many of the last starts.
        """
        stack = list(self._stack)
        if len(stack) < MAX_VERSIONS:
            return stack
        # The first one is the reference of the drift.
        oldest = self._models / stack[1].name
        if oldest.exists() and not is_old(oldest):
            raise HmcvtError(
                f"{len(stack)} models were put into service within {KEPT_STARTS} starts; "
                "call ~/revert before another one"
            )
        del stack[1]
        return stack

    def _path(self, stack: _Stack) -> Path:
        return self._models / stack[-1].name if stack else self.base

    def _serving(self, selection: _Selection) -> InService:
        return InService(selection.model, self._path(selection.stack), utc_now())

    def _newest_intact(self, stack: _Stack) -> _Selection:
        """Return the last model that is as it was put into service; the base when none is."""
        problems: list[str] = []
        while stack:
            *before, last = stack
            try:
                model = _with_fingerprint(self._models / last.name, last.fingerprint)
            except HmcvtError as error:
                problems.append(str(error))
                stack = before
                continue
            stack = [*before, last._replace(fingerprint=model.fingerprint)]
            return _Selection(stack, model, self._complaint(problems, stack, model))
        complaint = self._complaint(problems, [], self._base_model)
        return _Selection([], self._base_model, complaint)

    def _complaint(
        self, problems: list[str], stack: _Stack, model: EfficiencyModel
    ) -> str:
        """Return why a model is not the one expected, or answers otherwise; empty when it is."""
        path = self._path(stack)
        sentences = list(problems)
        if problems:
            sentences.append(f"{path} serves instead")
        if self._has_other_laws(stack, model):
            sentences.append(
                f"effects_file was changed since {path} was put into service, which may therefore "
                "answer otherwise: restore effects_file and start again, or call ~/reidentify"
            )
        return "; ".join(sentences)

    def _laws_of(self, model: EfficiencyModel) -> str:
        """Return by which laws a model answers, as `_Version.laws`."""
        for effect in model.effects:
            if not type(effect).__module__.startswith("hmcvt_core."):
                return self._effects_checksum
        return ""

    def _has_other_laws(self, stack: _Stack, model: EfficiencyModel) -> bool:
        """Whether a model answers by other laws than when it was put into service."""
        laws = stack[-1].laws if stack else self._base_laws
        return laws not in ("", self._laws_of(model))

    def _confirmed(self) -> EfficiencyModel:
        """Keep the model in service, which a refit by the present laws has confirmed."""
        stack = self._stack
        model = self.in_service.model
        if not self._has_other_laws(stack, model):
            return model
        if stack:
            stack = [*stack[:-1], stack[-1]._replace(laws=self._laws_of(model))]
        else:
            self._base_laws = self._laws_of(model)
        return self._commit(_Selection(stack, model))

    def _commit(self, selection: _Selection) -> EfficiencyModel:
        """Write the state, and serve a model."""
        self._write(selection.stack)
        self._stack = selection.stack
        self.complaint = selection.complaint
        self.in_service = self._serving(selection)
        return selection.model

    def _write(self, stack: _Stack) -> None:
        """Write the state with the models put into service."""
        state = {
            "base": str(self.base),
            "base_fingerprint": self._base_model.fingerprint,
            "base_laws": self._base_laws,
            "in_service": [version.name for version in stack],
            "fingerprints": [version.fingerprint for version in stack],
            "accepted": [version.accepted for version in stack],
            "laws": [version.laws for version in stack],
        }
        sealed = {**state, "checksum": _checksum(state)}
        require_plain_path(self._state.parent)
        require_plain_path(self._state)
        write_atomically(self._state, json.dumps(sealed, indent=1) + "\n")

    def _remember_base(self) -> None:
        """Write by which laws the base is served, unless it has no effect of the user."""
        if self._base_laws:
            with suppress(OSError):  # the state folder reports that itself
                self._write([])

    def _resumed(self) -> _Stack:
        """Return the models of an earlier run; none, with a complaint, if they are of no use."""
        try:
            state = json.loads(read_small(self._state))
            stack = _stack_of(state)
        except FileNotFoundError:
            self._remember_base()
            return []
        except (
            OSError,
            ValueError,
            KeyError,
            TypeError,
            AttributeError,
            RecursionError,
        ) as error:
            self.complaint = (
                f"{self._state}: cannot be read or is damaged ({error!r}); "
                f"{self.base} serves instead"
            )
            return []
        if state["base_fingerprint"] != self._base_model.fingerprint:
            if not stack:
                self._remember_base()
                return []
            # Another model_file asks for that model, not for an old refit of another.
            self.complaint = (
                f"{self._state}: is of another model_file ({state['base']})"
            )
            return []
        self._base_laws = state.get("base_laws", self._base_laws)
        return stack


def proven(promised: Promised) -> Path:
    """Return the first of some files, once all have proved to be what was put into service.

    Raises:
        InputError: one is not.
    """
    for path, fingerprint in promised:
        _with_fingerprint(path, fingerprint)
    return promised[0][0]


def servable(path: Path) -> EfficiencyModel:
    """Load the model of a transmission without the errors of one bench's meters.

    Raises:
        InputError: the file is missing, damaged or not to be served.
    """
    require_regular(path)
    model = load_model(path)
    if model.formulation != "power_balance":
        raise InputError(
            f"{path}: formulation {model.formulation!r} is not served: it has a pole "
            "inside the working range; identify with formulation power_balance"
        )
    return model.without_meters()


def utc_now() -> str:
    """Return the time as the node writes it everywhere."""
    return datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")


def _stack_of(state: dict[str, Any]) -> _Stack:
    """Read a state.

    Raises:
        ValueError: it has no checksum, or another one, or wrong names.
        KeyError: a key is missing.
    """
    if state.pop("checksum", None) != _checksum(state):
        raise ValueError("its checksum is missing or does not match")
    names = state["in_service"]
    fingerprints = state["fingerprints"]
    accepted = state["accepted"]
    laws = state.get("laws", [""] * len(names))
    if any(Path(name).name != name for name in names):
        raise ValueError("names are no file names")
    return [
        _Version(*values)
        for values in zip(names, fingerprints, accepted, laws, strict=True)
    ]


def _checksum(state: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(state, sort_keys=True).encode()).hexdigest()


def _with_fingerprint(path: Path, fingerprint: str) -> EfficiencyModel:
    """Load the model that has a fingerprint; any where that is not known."""
    model = servable(path)
    if fingerprint not in ("", model.fingerprint):
        raise InputError(
            f"{path}: is not what was written: fingerprint "
            f"{model.fingerprint}, not {fingerprint}"
        )
    return model
