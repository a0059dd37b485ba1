# SPDX-License-Identifier: BSD-3-Clause
"""The laboratory of blocks: rigid convex blocks thrown at yielding, rough ground.

A `BlockCase` says what is thrown at what, `run_throws` throws it and gives a table of contacts.
"""
