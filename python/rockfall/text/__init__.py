# SPDX-License-Identifier: BSD-3-Clause
"""Results in words, for a terminal."""
