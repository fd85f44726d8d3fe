# SPDX-License-Identifier: Apache-2.0
"""Every number and figure of the paper beside ours."""

from .item import Item
from .procedure import Reproduction, reproduce

__all__ = ["Item", "Reproduction", "reproduce"]
