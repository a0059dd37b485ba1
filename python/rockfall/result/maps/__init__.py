# SPDX-License-Identifier: BSD-3-Clause
"""Maps of a result: classes, labels, thresholds."""
