# SPDX-License-Identifier: BSD-3-Clause
"""Studies: several runs of a case, made from scenes that differ, and what they show."""
