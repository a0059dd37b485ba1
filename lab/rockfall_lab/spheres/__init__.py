# SPDX-License-Identifier: BSD-3-Clause
"""Spheres and clumps of spheres: impacts on a layer of rocks, and throws along the layer."""
