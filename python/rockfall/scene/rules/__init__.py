# SPDX-License-Identifier: BSD-3-Clause
"""Rules that find implausible inputs, by subject."""
