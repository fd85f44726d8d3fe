# SPDX-License-Identifier: Apache-2.0
"""The process beside the node that does the heavy work: `python -m hmcvt_ros.worker`.

It reads JSON requests from standard input, a line each, and answers each with a line on standard
output. It ends when its standard input closes, which happens in whatever way the node dies.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import threading
import time
from collections.abc import Mapping
from typing import Any


def main() -> None:
    """Answer requests until there are no more."""
    _step_back()
    # Ctrl-C in a terminal reaches every process of the group; the node decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What the work prints is not an answer.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    # Imported now: that is heavy work, too.
    from hmcvt_ros.json_text import json_text

    requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(requests,), daemon=True).start()
    while True:
        print(json_text(answer(json.loads(requests.get()))), file=answers, flush=True)


def answer(request: Mapping[str, Any]) -> dict[str, Any]:
    """Do one job; a failure that a person can mend comes back as `error`."""
    from hmcvt_core.errors import HmcvtError
    from hmcvt_ros.jobs import JOBS

    started = time.monotonic()
    try:
        result = JOBS[request["job"]](request)
    except (HmcvtError, OSError) as error:
        return {"error": str(error)}
    return {**result, "seconds": round(time.monotonic() - started, 3)}


def _step_back() -> None:
    """Compute only while nobody else wants to."""
    if hasattr(os, "SCHED_IDLE"):  # Linux
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    else:
        os.nice(19)


def _read(requests: queue.SimpleQueue[bytes]) -> None:
    """Take requests; when no more can come, end the process, in the middle of its work too."""
    with os.fdopen(0, "rb") as lines:
        for line in lines:
            requests.put(line)
    os._exit(0)


if __name__ == "__main__":
    main()
