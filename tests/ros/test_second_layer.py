# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is left when a limit of the machine ends something: the node rather than its job."""

from __future__ import annotations

from pathlib import Path

from ros_bench import send_table


def oom_score(pid):
    """How much rather than others the kernel ends a process where memory runs out, to 1000."""
    return int(Path(f"/proc/{pid}/oom_score_adj").read_text())


def test_where_memory_runs_out_the_job_ends_and_not_the_node(node, table2):
    send_table(node, table2)
    assert node.player.call("reidentify", 60.0).success
    assert max(map(oom_score, node.children())) == 1000  # the worker, which waits for the next job
    assert oom_score(node.process.pid) == oom_score("self") < 1000
