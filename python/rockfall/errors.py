# SPDX-License-Identifier: BSD-3-Clause
"""The one exception a user of rockfall meets, and what raises it in many places."""

from importlib import import_module


class RockfallError(ValueError):
    """One line that says what is wrong, where, and what is allowed.

    `code` is the exit status: 2 when the input can be corrected, 1 when the fault is ours.
    """

    def __init__(self, message: str, code: int = 2) -> None:
        super().__init__(" ".join(str(message).splitlines()))
        self.code = code


def check_kernel(code: int, message: bytes, name: str = "") -> None:
    """Raise what the kernel says is wrong; `name` comes before a line that has none."""
    if code:
        text = message.decode(errors="replace").strip()
        raise RockfallError(f"{name}: {text}" if name else text, code)


def need(what: str, extra: str, *packages: str) -> None:
    """Refuse what needs packages that are not there; an extra of rockfall brings them."""
    try:
        for package in packages:
            import_module(package)
    except ModuleNotFoundError:
        advice = f"the {extra} extra: pip install 'rockfall[{extra}]'"
        raise RockfallError(f"{what} {advice}") from None
