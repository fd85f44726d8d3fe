# SPDX-License-Identifier: Apache-2.0
"""What a person looks at: the page of a diagnosis and the pictures."""
