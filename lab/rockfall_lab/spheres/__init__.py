# SPDX-License-Identifier: BSD-3-Clause
"""Spheres and clumps of them: impacts on a layer of rocks, and throws along one."""
