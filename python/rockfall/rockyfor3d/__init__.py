# SPDX-License-Identifier: BSD-3-Clause
"""Import of folders of the program Rockyfor3D as cases (docs/rockyfor3d.md)."""
