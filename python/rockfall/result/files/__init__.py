# SPDX-License-Identifier: BSD-3-Clause
"""Results as files for a GIS, for CAD and for viewers of the Earth."""
