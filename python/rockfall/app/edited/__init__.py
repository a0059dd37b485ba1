# SPDX-License-Identifier: BSD-3-Clause
"""The case edited in the live window."""
