# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The model outside Python: C for a controller, an FMU, maps for MATLAB, a page to play with."""

from .c_folder import export_c
from .fmu import export_fmu
from .matlab import export_mat
from .page import write_page

__all__ = ["export_c", "export_fmu", "export_mat", "write_page"]
