# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The model outside Python: C for a controller, an FMU, maps for MATLAB, a page that computes.

c_folder  `export_c`: model (`c_model`, its `constants`), self-test (`vectors`), A2L description
          (`a2l`); `effect_tables` hold what effects change, `stage_choice` chooses the stage
fmu       `export_fmu`: `fmi_description` and `fmi_variables` around the same C
matlab    `export_mat`: `maps` of every stage
page      `write_page`: the same C as `javascript`

`c_text` writes constants as C, `compiler` finds and runs the compilers, `folder` writes whole.
"""

from .c_folder import export_c
from .fmu import export_fmu
from .matlab import export_mat
from .page import write_page

__all__ = ["export_c", "export_fmu", "export_mat", "write_page"]
