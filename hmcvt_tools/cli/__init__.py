# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The command `hmcvt`: thin commands that parse, call and print (libraries: extra `tools`).

commands    names of all commands, exit codes
common      what commands share; commands of other packages use it too

The other modules hold one command each, or a few of a kind, as `point` and `gap`. `logs` has what
commands on logs share, `import_checks` checks of `import`, `gap_cost` the fuel that a gap costs;
`progress`, `outputs`, `quantities` and `samples` serve several commands.
"""

import sys
from importlib.util import find_spec

LIBRARIES = ("click", "pandas", "pint")
"""What the extra `tools` installs."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit; in one line where a library is missing."""
    missing = [name for name in LIBRARIES if find_spec(name) is None]
    if missing:
        print(
            f"hmcvt: error: the command line needs {', '.join(missing)}: in the folder of hmcvt, "
            'pip install ".[tools]"',
            file=sys.stderr,
        )
        sys.exit(2)
    from .commands import main as run

    run(arguments)
