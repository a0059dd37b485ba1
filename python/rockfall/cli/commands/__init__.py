# SPDX-License-Identifier: BSD-3-Clause
"""Commands, one module each."""
