# SPDX-License-Identifier: BSD-3-Clause
"""Command line: from arguments to exit status."""

from rockfall.cli.command_line import main as main
