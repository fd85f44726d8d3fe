# SPDX-License-Identifier: Apache-2.0
"""The models of a node: the one it starts from, those refitted, and which one is in service.

    <state folder>/models/0001.yaml ...   every refitted model, never overwritten
    <state folder>/in_service.json        the models put into service one after the other

The second file is replaced as a whole, so that a crash at any moment leaves the model before or
the one after in service.
"""

from __future__ import annotations

import json
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

from hmcvt_core import EfficiencyModel, HmcvtError, InputError, load_model
from hmcvt_core.files.atomic import write_atomically

from .state_folder import next_name


class InService(NamedTuple):
    """A model without errors of meters, its parameter file, and since when it serves (UTC)."""

    model: EfficiencyModel
    path: Path
    since: str


class ModelStore:
    """Which model is in service, and the way back.

    One thread at a time may change it; others may look at `in_service` meanwhile.

    Attributes:
        base: the parameter file that the node was given.
        in_service: the model in service.
        complaint: why a refitted model of an earlier run was not taken up; empty when it was.
    """

    def __init__(self, base: Path, folder: Path) -> None:
        """Take up the state in `folder` for a node that starts from the file `base`.

        Raises:
            InputError: the file `base` is missing, damaged or not to be served.
        """
        self.base = base.resolve()
        self.complaint = ""
        self._models = folder / "models"
        self._state = folder / "in_service.json"
        base_model = servable(base)
        self._base_fingerprint = base_model.fingerprint
        self._stack, model = self._resumed(base_model)
        self.in_service = InService(model, self._path(self._stack), utc_now())

    def new_path(self) -> Path:
        """Return a free name for a refitted model.

        Raises:
            OSError: the folder cannot be made.
        """
        return next_name(self._models).with_suffix(".yaml")

    def adopt(self, path: Path, instead_of: Path | None = None,
              model: EfficiencyModel | None = None) -> EfficiencyModel:
        """Put a model written under `new_path` into service.

        Args:
            path: of the model.
            instead_of: the parameter file that must be in service; any when left out.
            model: what `servable` makes of the file, where that has been done already.

        Raises:
            HmcvtError: another is in service.
            InputError: the file is damaged or not to be served; the model before stays.
            OSError: the state cannot be written; the model before stays.
        """
        if instead_of not in (None, self.in_service.path):
            raise HmcvtError("the model in service changed meanwhile, and the refit was "
                             "compared with the one before; call again")
        return self._commit([*self._stack, path.name], model or servable(path))

    def revert(self) -> EfficiencyModel:
        """Put the model before into service.

        Raises:
            HmcvtError: there is none.
            InputError, OSError: it cannot be loaded or the state not be written; nothing changes.
        """
        if not self._stack:
            raise HmcvtError("the model in service is the one of model_file; there is none before")
        stack = self._stack[:-1]
        return self._commit(stack, servable(self._path(stack)))

    def _path(self, stack: list[str]) -> Path:
        return self._models / stack[-1] if stack else self.base

    def _commit(self, stack: list[str], model: EfficiencyModel) -> EfficiencyModel:
        state = {"base": str(self.base), "base_fingerprint": self._base_fingerprint,
                 "in_service": stack}
        write_atomically(self._state, json.dumps(state, indent=1) + "\n")
        self._stack = stack
        self.in_service = InService(model, self._path(stack), utc_now())
        return model

    def _resumed(self, base: EfficiencyModel) -> tuple[list[str], EfficiencyModel]:
        """Refits and model in service of an earlier run, as far as they can be taken up."""
        try:
            state = json.loads(self._state.read_text(encoding="utf-8"))
            stack = [str(name) for name in state["in_service"]]
            fingerprint = state["base_fingerprint"]
        except FileNotFoundError:
            return [], base
        except (OSError, ValueError, KeyError, TypeError) as error:
            self.complaint = f"{self._state}: cannot be read ({error!r})"
            return [], base
        if fingerprint != base.fingerprint:
            # Whoever starts the node from another model wants that one, not an old refit.
            self.complaint = f"{self._state}: is of another model_file ({state.get('base')})"
            return [], base
        while stack:
            try:
                return stack, servable(self._path(stack))
            except HmcvtError as error:
                self.complaint = str(error)
                stack.pop()
        return stack, base


def servable(path: Path) -> EfficiencyModel:
    """Load the model of a transmission: not what the meters of one bench make of it.

    Raises:
        InputError: the file is missing, damaged or not to be served.
    """
    model = load_model(path)
    if model.formulation != "power_balance":
        raise InputError(f"{path}: formulation {model.formulation!r} is not served: it has a pole "
                         "inside the working range; identify with formulation power_balance")
    return model.without_meters()


def utc_now() -> str:
    """Return the time as the node writes it everywhere."""
    return datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
