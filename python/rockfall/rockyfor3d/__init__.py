# SPDX-License-Identifier: BSD-3-Clause
"""Folders of the program Rockyfor3D, as cases of ours (docs/rockyfor3d.md)."""
