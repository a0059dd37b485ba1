# SPDX-License-Identifier: BSD-3-Clause
"""First inputs of a project: a DEM from surveyed points, an edited DEM, a commented case."""
