# SPDX-License-Identifier: BSD-3-Clause
"""Runs with uncertain inputs: uncertainty of a result, and its causes."""
