# SPDX-License-Identifier: BSD-3-Clause
"""Live window: a local server for a page in the browser, to draw and run a case."""
