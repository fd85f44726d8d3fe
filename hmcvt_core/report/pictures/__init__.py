# SPDX-License-Identifier: Apache-2.0
"""Pictures of fits, losses and efficiency maps; need matplotlib (extra `plot`)."""

from .canvas import FORMATS, save, writes
from .fit import draw_fit
from .losses import draw_losses
from .surface import draw_surface

__all__ = ["FORMATS", "draw_fit", "draw_losses", "draw_surface", "save", "writes"]
