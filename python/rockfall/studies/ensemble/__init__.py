# SPDX-License-Identifier: BSD-3-Clause
"""Runs over the uncertain inputs of a case: uncertainty of a result, and its causes."""
