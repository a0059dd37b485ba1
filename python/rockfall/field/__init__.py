# SPDX-License-Identifier: BSD-3-Clause
"""Data of field experiments and events: where they are published, and how they come here."""
