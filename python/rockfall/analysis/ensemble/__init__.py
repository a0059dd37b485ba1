# SPDX-License-Identifier: BSD-3-Clause
"""Runs over the uncertain inputs of a case: how uncertain a result is, and what makes it so."""
