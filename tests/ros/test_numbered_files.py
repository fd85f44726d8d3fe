# SPDX-License-Identifier: Apache-2.0
"""Numbered files in the state folder."""

from __future__ import annotations

from hmcvt_ros.numbered_files import keep_newest, next_name


def test_numbers_rise_and_are_not_used_again(tmp_path):
    folder = tmp_path / "reports"
    for number in range(1, 13):
        path = next_name(folder)
        assert path == folder / f"{number:04d}"
        path.with_suffix(".html").write_text("")
        path.with_suffix(".json").write_text("")
        keep_newest(folder, 3)
    (folder / "notes.txt").write_text("mine")
    keep_newest(folder, 2)
    assert sorted(path.name for path in folder.iterdir()) == [
        "0011.html", "0011.json", "0012.html", "0012.json", "notes.txt"]
    assert next_name(folder).name == "0013"
