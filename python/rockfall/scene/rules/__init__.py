# SPDX-License-Identifier: BSD-3-Clause
"""Rules for implausible inputs, grouped by subject."""
