# SPDX-License-Identifier: BSD-3-Clause
"""The case that is edited in the live window."""
