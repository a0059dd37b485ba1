# SPDX-License-Identifier: BSD-3-Clause
"""Version of the package, defined only in meson.build."""

import sys
from glob import iglob

_BEGIN, _END = "rockfall-", ".dist-info"
#: Metadata folder that the installer creates next to the package, absent in a source tree. It is
#: read directly, because importing importlib.metadata takes a tenth of a small run's time.
_FOLDERS = (name for path in sys.path for name in iglob(f"{_BEGIN}*{_END}", root_dir=path or "."))
__version__ = next(_FOLDERS, "unknown").removeprefix(_BEGIN).removesuffix(_END)
