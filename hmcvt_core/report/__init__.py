# SPDX-License-Identifier: Apache-2.0
"""What a person looks at: the page of a diagnosis and the pictures (extra `report`)."""

from .losses import draw_losses
from .page import html, write_html
from .pictures import draw_fit, draw_surface, save
from .style import FORMATS, check_drawable

__all__ = [
    "FORMATS", "check_drawable", "draw_fit", "draw_losses", "draw_surface", "html", "save",
    "write_html",
]
