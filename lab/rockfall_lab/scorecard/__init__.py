# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets compared with published numbers, on a stand-in for the experimental slope."""
