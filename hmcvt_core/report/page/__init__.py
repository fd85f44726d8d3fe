# SPDX-License-Identifier: Apache-2.0
"""Parts of the page that shows a diagnosis: words, figures, tables, style."""
