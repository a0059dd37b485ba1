# SPDX-License-Identifier: BSD-3-Clause
"""The first inputs of a project: a DEM of surveyed points, an edited one, and a commented case."""
