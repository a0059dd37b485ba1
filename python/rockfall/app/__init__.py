# SPDX-License-Identifier: BSD-3-Clause
"""Live window: a local server for a page in the browser, in which a case is drawn and run."""
