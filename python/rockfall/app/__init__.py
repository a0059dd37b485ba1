# SPDX-License-Identifier: BSD-3-Clause
"""Live window to draw and run a case: a local server and its page in the browser."""
