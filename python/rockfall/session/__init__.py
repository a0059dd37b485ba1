# SPDX-License-Identifier: BSD-3-Clause
"""An open scene, its changes, and its runs in batches."""
