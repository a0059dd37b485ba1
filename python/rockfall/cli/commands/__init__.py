# SPDX-License-Identifier: BSD-3-Clause
"""Commands, with a module for each."""
