# SPDX-License-Identifier: BSD-3-Clause
"""Vector layers, drawings and points in, layers out."""
