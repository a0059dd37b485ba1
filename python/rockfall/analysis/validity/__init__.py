# SPDX-License-Identifier: BSD-3-Clause
"""Validity of a run's model: remarks on its rebounds, boulders and obstacles."""
