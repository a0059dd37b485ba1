# SPDX-License-Identifier: BSD-3-Clause
"""The version of the package, which stands in meson.build alone."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("rockfall")
except PackageNotFoundError:  # a source tree that is not installed
    __version__ = "unknown"
