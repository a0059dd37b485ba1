# SPDX-License-Identifier: BSD-3-Clause
"""Import of Rockyfor3D folders as cases (docs/rockyfor3d.md)."""
