# SPDX-License-Identifier: BSD-3-Clause
"""Version of the package, which is defined in meson.build only."""

import sys
from glob import iglob

_BEGIN, _END = "rockfall-", ".dist-info"
#: What the installer calls the folder beside the package, as importlib.metadata knows it too, which
#: takes a tenth of a small run to import. Unknown in a source tree.
_FOLDERS = (one for path in sys.path for one in iglob(f"{_BEGIN}*{_END}", root_dir=path or "."))
__version__ = next(_FOLDERS, "unknown").removeprefix(_BEGIN).removesuffix(_END)
