# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What of a status goes into a message: some keys always, the others when they change."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from hmcvt_ros.diagnostics import ALL_EVERY, NEW_LISTENER, ChangeFilter


def status(level=DiagnosticStatus.OK, **values):
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticStatus(name="hmcvt: gap", level=level, values=pairs)


@pytest.fixture
def keys():
    """Return the keys that a message would have; the first message is out already."""
    change_filter = ChangeFilter()

    def keys(now, listeners=0, **options):
        given = status(**{"samples": "1", "open": "False", "size": "-", **options})
        (reduced,) = change_filter.reduce([given], now, listeners)
        return [pair.key for pair in reduced.values]

    assert keys(0.0) == ["samples", "open", "size"]
    return keys


def test_key_comes_when_its_value_changes(keys):
    assert keys(1.0) == ["samples", "open"]
    assert keys(2.0, size="0.01") == ["samples", "open", "size"]
    assert keys(3.0, size="0.01") == ["samples", "open"]
    assert keys(4.0, since="7") == ["samples", "open", "size", "since"]


def test_all_keys_come_while_the_level_is_not_ok(keys):
    for level in (DiagnosticStatus.WARN, DiagnosticStatus.ERROR):
        assert keys(1.0, level=level) == ["samples", "open", "size"]
    assert keys(2.0) == ["samples", "open"]


def test_all_keys_come_for_a_new_listener_and_once_in_a_while(keys):
    assert keys(1.0, listeners=2) == ["samples", "open", "size"]
    assert keys(1.0 + NEW_LISTENER, listeners=2) == ["samples", "open", "size"]
    assert keys(2.0 + NEW_LISTENER, listeners=1) == ["samples", "open"]
    last = 1.0 + NEW_LISTENER
    assert keys(last + 0.9 * ALL_EVERY) == ["samples", "open"]
    assert keys(last + ALL_EVERY) == ["samples", "open", "size"]
    assert keys(last + ALL_EVERY + 1.0) == ["samples", "open"]
