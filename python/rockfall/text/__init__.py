# SPDX-License-Identifier: BSD-3-Clause
"""Results as text for a terminal."""
