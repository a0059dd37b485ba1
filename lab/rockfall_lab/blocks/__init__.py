# SPDX-License-Identifier: BSD-3-Clause
"""The block laboratory: rigid convex blocks thrown at yielding, rough ground.

A `BlockCase` defines blocks, ground and throws; `run_throws` simulates them and returns their
contacts.
"""
