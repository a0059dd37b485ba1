# SPDX-License-Identifier: BSD-3-Clause
"""Reading of vector layers, drawings and points, and writing of layers."""
