# SPDX-License-Identifier: BSD-3-Clause
"""Live window to draw and run a case: a local server for a page in the browser."""
