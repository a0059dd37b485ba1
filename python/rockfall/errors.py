# SPDX-License-Identifier: BSD-3-Clause
"""The exception that rockfall raises for users, and functions that raise it."""

from importlib import import_module

BAD_INPUT = 2  # exit status of errors that the user can correct, as in the kernel
OUR_FAULT = 1  # exit status of internal errors


#: Packages of an extra that most of its uses import.
EXTRAS = {
    "vector": ("nanoarrow", "pyogrio", "shapely"), "report": ("matplotlib",), "cad": ("ezdxf",)
}  # fmt: skip
FAULT_MARK = "\x1e"  # separates several errors in a kernel message


class RockfallError(ValueError):
    """A one-line message with the problem, its place, and the allowed values. If a case has
    several problems, `faults` has a line for each.

    `code` is the exit status: `BAD_INPUT` (2) or `OUR_FAULT` (1).

    >>> import rockfall
    >>> try:
    ...     rockfall.read_case("case.nml").replace(boulder={"density": -1.0})
    ... except rockfall.RockfallError as error:
    ...     print(error, error.code)
    case.nml: &boulder density = -1.0: must be > 0 [kg/m3] 2
    """

    def __init__(self, message: str, code: int = BAD_INPUT) -> None:
        super().__init__(message)
        self.faults = [" ".join(fault.splitlines()) for fault in str(message).split(FAULT_MARK)]
        self.code = code

    def __str__(self) -> str:
        return "\n".join(self.faults)


def check_kernel(code: int, message: bytes, name: str = "") -> None:
    """Raise a RockfallError with the kernel's message if `code` is not 0; `name` is put in
    front."""
    if code:
        text = message.decode(errors="replace").strip()
        raise RockfallError(f"{name}: {text}" if name else text, code)


def need(what: str, extra: str, *packages: str) -> None:
    """If a package is missing, raise a RockfallError: `what`, and the advice to install `extra`, or
    the package itself. Default: the usual packages of the extra."""
    for package in packages or EXTRAS[extra]:
        try:
            import_module(package)
        except ModuleNotFoundError:
            source = f"the {extra} extra: pip install 'rockfall[{extra}]'"
            advice = source if extra else f"{package}: pip install {package}"
            raise RockfallError(f"{what} {advice}") from None
