# SPDX-License-Identifier: BSD-3-Clause
"""Parts of a run: files, checkpoints, merging, locks."""
