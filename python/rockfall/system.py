# SPDX-License-Identifier: BSD-3-Clause
"""Differences between operating systems: memory, locks, durable files, signals."""

import ctypes
import errno
import os
import shutil
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

#: Signals that stop a process: Ctrl-C, and SIGTERM or SIGBREAK from batch systems at a time limit.
STOPS: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM)
#: Flag for os.open that refuses symbolic links; 0 on systems without it.
NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)
#: Encoding of paths passed to netCDF: on Windows it expects the code page, not UTF-8.
NETCDF_NAMES = "mbcs" if sys.platform == "win32" else None
#: Errors for a full disk, an exceeded quota, or the file size limit.
FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EFBIG)


def check_free(folder: Path, size: int) -> None:
    """Raise an OSError if the disk of a folder has less free space than `size` [bytes]."""
    if shutil.disk_usage(folder).free < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


if sys.platform == "win32":
    import msvcrt

    STOPS = (*STOPS, signal.SIGBREAK)

    class _MemoryStatus(ctypes.Structure):
        """The Windows structure MEMORYSTATUSEX."""

        _fields_ = [
            ("dwLength", ctypes.c_uint32),
            ("dwMemoryLoad", ctypes.c_uint32),
            ("ullTotalPhys", ctypes.c_uint64),
            ("others", ctypes.c_uint64 * 6),
        ]

    def physical_memory() -> int:
        """Memory of the machine [bytes]."""
        status = _MemoryStatus(dwLength=ctypes.sizeof(_MemoryStatus))
        ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
        return int(status.ullTotalPhys)

    def memory_limits() -> list[int]:
        """Memory limits of this process [bytes], apart from the machine's memory."""
        return []

    def lock(descriptor: int) -> None:
        """Lock an open file until it closes; raises BlockingIOError if it is locked already."""
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError as error:
            if error.errno not in (errno.EACCES, 0):  # 0: Wine's C library sets no error number
                raise
            raise BlockingIOError(error.errno, error.strerror) from None

    def has_locks(path: str) -> bool:
        """Return True: on this system, all file systems can lock files."""
        return True

    def reserve(folder: Path, size: int) -> None:
        """Raise an OSError if a folder cannot hold a file of this size [bytes]."""
        check_free(folder, size)

    def remove_locked(path: Path, descriptor: int) -> None:
        """Close a locked file and remove it; Windows cannot remove an open file."""
        os.close(descriptor)
        with suppress(OSError):  # another process has opened or removed it
            path.unlink()

    def sync(path: Path) -> None:
        """Flush a file to disk; the file system flushes folder entries itself."""
        if path.is_file():
            descriptor = os.open(path, os.O_RDWR)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)

    def replace(source: Path, target: Path) -> None:
        """Rename a file, replacing an existing one; retry for a second, because virus scanners and
        backup programs may keep new files open."""
        for _ in range(10):
            try:
                return os.replace(source, target)
            except PermissionError:
                time.sleep(0.1)
        os.replace(source, target)

    def before_fork(call: Callable[[], object]) -> None:
        """Do nothing, because this system has no fork."""

else:
    import fcntl
    import resource

    def physical_memory() -> int:
        """Memory of the machine [bytes]."""
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")

    def memory_limits() -> list[int]:
        """Memory limits of this process [bytes], apart from the machine's memory."""
        return [limit for limit in resource.getrlimit(resource.RLIMIT_AS)[:1] if limit > 0]

    def lock(descriptor: int) -> None:
        """Lock an open file until it closes; raises BlockingIOError if it is locked already."""
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def has_locks(path: str) -> bool:
        """Return False if the file system of a file or folder cannot lock files."""
        try:
            descriptor = os.open(path, os.O_RDONLY)
        except OSError:
            return True
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
        finally:
            os.close(descriptor)
        return True

    def reserve(folder: Path, size: int) -> None:
        """Raise an OSError if a folder cannot hold a file of this size [bytes]. Where the system
        can reserve space, this includes quotas and `ulimit -f`."""
        with tempfile.TemporaryFile(dir=folder) as file:
            allocate = getattr(ctypes.CDLL(None, use_errno=True), "fallocate", None)  # Linux only
            if allocate and allocate(file.fileno(), 0, ctypes.c_long(0), ctypes.c_long(size)) == 0:
                return
            if allocate and (reason := ctypes.get_errno()) in FULL:
                raise OSError(reason, os.strerror(reason))
        check_free(folder, size)

    def remove_locked(path: Path, descriptor: int) -> None:
        """Remove a locked file, then close it; no other process can lock it in between."""
        with suppress(OSError):  # another process has removed it
            path.unlink()
        os.close(descriptor)

    def sync(path: Path) -> None:
        """Flush a file, or the entries of a folder, to disk; some systems cannot flush folders."""
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        except OSError:
            if not path.is_dir():
                raise
        finally:
            os.close(descriptor)

    def replace(source: Path, target: Path) -> None:
        """Rename a file, replacing an existing one."""
        os.replace(source, target)

    def before_fork(call: Callable[[], object]) -> None:
        """Call a function before the process forks."""
        os.register_at_fork(before=call)


def signal_channel() -> tuple[socket.socket, socket.socket]:
    """Connected sockets (reader, writer) for `signal.set_wakeup_fd`; all systems support them."""
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    return reader, writer
