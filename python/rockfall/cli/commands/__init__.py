# SPDX-License-Identifier: BSD-3-Clause
"""The commands, each in a module."""
