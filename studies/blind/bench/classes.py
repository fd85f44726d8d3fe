# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects that no test can distinguish, counted as one class."""

from collections.abc import Mapping, Sequence

ENGINE_TORQUE = "constant torque on the engine side"
PROPORTIONAL = "loss in proportion on an output-coupled stage"
_METER = "torque_sensor"


def class_of(name: str, form: str, output_coupled: bool) -> str:
    """Return the class of an effect; its own name where it is alone in it.

    Args:
        name: of the effect.
        form: of a torque meter's error, as "engine_zero" or "zero of the engine meter".
        output_coupled: whether every stage tested is output-coupled.
    """
    if name in ("charge_pump", "bearing_drag"):
        return ENGINE_TORQUE
    if name == _METER and "engine" in form and "zero" in form:
        return ENGINE_TORQUE
    if output_coupled and name in ("gear_mesh", "planetary_mesh"):
        return PROPORTIONAL
    if output_coupled and name == _METER and "gain" in form:
        return PROPORTIONAL
    return name


def classes_of(
    names: Sequence[str], forms: Mapping[str, str], output_coupled: bool
) -> list[str]:
    """Return the classes of a set of effects, each once, in order."""
    classes = {class_of(name, forms.get(name, ""), output_coupled) for name in names}
    return sorted(classes)
