# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that appear together or not at all: temporary names, locks, and the way back.

Nothing is ever written in place. A killed process leaves the old files whole and some hidden temporary ones,
which the next bake into that folder removes.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
import socket
import sys
import threading
import time
import zlib
from collections.abc import Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO

from .errors import OutputError

LOCK_NAME = ".radiosity.lock"
MAX_STEM_BYTES = 150
"""File systems take names of 255 bytes; this leaves room for what is appended."""

SHARING_SECONDS = 2.0 if sys.platform == "win32" else 0.0
"""On Windows virus scanners and indexers open new files at once, and none can be moved while anybody has it open."""
OPEN_FILES_GO = sys.platform != "win32"
"""Whether a file can be removed while it is open."""
IN_USE = (5, 32)
"""Windows' errors of files that somebody has open: access denied, sharing violation."""

_HOST = f"{zlib.crc32(socket.gethostname().encode()):08x}"
_TEMPORARY = re.compile(r"\.radiosity-([0-9a-f]{8})-(\d+)-\d+")
_count = 0


class Transaction:
    """A set of files written under temporary names, put in place one by one, and taken back unless committed.

    Use it as a context manager. Leaving it without `commit()`, by an error or not, brings back every file that was
    there before and removes the folders it made. A thread that still writes then, for a bake that was cancelled, is
    turned away when its file is done, and that file goes too.
    """

    def __init__(self) -> None:
        self._temporary: dict[Path, Path] = {}
        self._backup: dict[Path, Path | None] = {}
        self._folders: list[Path] = []
        self._locks: list[_FolderLock] = []
        self._left = False
        self._placing = threading.Lock()

    def __enter__(self) -> Transaction:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._placing:
            self._left = True
        for temporary in self._temporary.values():
            with suppress(PermissionError):  # on Windows, while a thread writes it, who will remove it
                temporary.unlink(missing_ok=True)
        for target, backup in reversed(self._backup.items()):
            if backup is None:
                with suppress(PermissionError):  # on Windows, while somebody looks at it
                    target.unlink(missing_ok=True)
            else:
                _replace(backup, target)
        self._backup.clear()
        for lock in self._locks:
            lock.release()
        for folder in reversed(self._folders):
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()

    def make_folder(self, folder: Path) -> None:
        """Make sure that a folder exists and can be written to, and remove what a killed bake left in it."""
        try:
            for missing in [path for path in (*reversed(folder.parents), folder) if not path.exists()]:
                missing.mkdir(exist_ok=True)
                self._folders.append(missing)
            if not folder.is_dir():
                raise OutputError(str(folder), "it is a file, not a folder", "Choose another folder")
            _remove_stale(folder)
            probe = _temporary_name(folder, "")
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise _output_error(folder, error) from error

    def lock(self, folder: Path) -> None:
        """Keep other bakes out of a folder until this transaction ends.

        Raises:
            OutputError: another bake holds it
        """
        self._locks.append(_FolderLock(folder))

    def begin(self, target: Path) -> Path:
        """The temporary path, beside the target and with its suffix, to write a file to.

        Raises:
            OutputError: a folder has this name
            CancelledError: the transaction was left
        """
        if self._left:
            raise CancelledError
        check_is_no_folder(target)
        self._temporary[target] = _temporary_name(target.parent, target.suffix)
        return self._temporary[target]

    def place(self, target: Path) -> None:
        """Move the finished temporary file to its target; the old file is kept aside until `commit()`.

        Raises:
            OutputError: it can't be moved
            CancelledError: the transaction was left
        """
        temporary = self._temporary[target]
        try:
            with temporary.open("r+b") as file:
                os.fsync(file.fileno())
            with self._placing:
                if self._left:
                    temporary.unlink(missing_ok=True)
                    raise CancelledError
                first = target not in self._backup
                if first:
                    self._backup[target] = _keep(target)
                try:
                    _replace(temporary, target)
                except OSError:
                    if first:  # nothing has changed that would have to be taken back
                        self._drop_backup(target)
                    raise
        except OSError as error:
            raise _output_error(target, error) from error
        del self._temporary[target]

    def commit(self) -> None:
        """Keep all that was placed."""
        for target in list(self._backup):
            self._drop_backup(target)
        self._folders.clear()

    def _drop_backup(self, target: Path) -> None:
        backup = self._backup.pop(target)
        if backup is not None:
            with suppress(PermissionError):  # on Windows, while somebody has it open: the next bake removes it
                backup.unlink(missing_ok=True)


def check_is_no_folder(target: Path) -> None:
    """Whether a file can have this name.

    Raises:
        OutputError: a folder has it
    """
    if target.is_dir():
        raise OutputError(str(target), "a folder has this name", "Choose another file name")


def write_text(target: Path, text: str, files: Transaction) -> None:
    """Write a text file, UTF-8, as part of a transaction."""
    try:
        files.begin(target).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise _output_error(target, error) from error
    files.place(target)


def write_bytes(target: Path, pieces: Sequence[bytes], files: Transaction) -> None:
    """Write a file in pieces and read it back, as part of a transaction.

    Raises:
        OutputError: it can't be written, or came back different
    """
    temporary = files.begin(target)
    try:
        with temporary.open("wb") as file:
            file.writelines(pieces)
        with temporary.open("rb") as file:
            same = all(file.read(len(piece)) == piece for piece in pieces) and not file.read(1)
    except OSError as error:
        raise _output_error(target, error) from error
    if not same:
        raise OutputError(str(target), "the file did not come back as it was written", "Choose another folder")
    files.place(target)


def safe_stem(name: str) -> str:
    """A file name part that every file system takes; two different names never become the same one."""
    safe = re.sub(r"[^\w\-. ]", "_", name).strip(". ")
    while len(safe.encode()) > MAX_STEM_BYTES:
        safe = safe[:-1]
    if safe == name:
        return safe
    return f"{safe or 'scene'}-{hashlib.sha256(name.encode('utf-8', 'surrogatepass')).hexdigest()[:6]}"


def _output_error(path: Path, error: OSError) -> OutputError:
    cause = (error.strerror or str(error)).lower()
    if error.errno == errno.ENOSPC:
        return OutputError(str(path), cause, "Free some space and try again")
    if getattr(error, "winerror", None) in IN_USE:
        return OutputError(
            str(path), cause, "Close programs that have it open, or choose a folder that you may write to"
        )
    return OutputError(str(path), cause, "Choose a folder that you may write to")


def _temporary_name(folder: Path, suffix: str) -> Path:
    global _count
    _count += 1
    return folder / f".radiosity-{_HOST}-{os.getpid()}-{_count}{suffix}"


def _replace(source: Path, target: Path) -> None:
    """Move a file to a name that may be taken, waiting a little for those who have either open."""
    end = time.monotonic() + SHARING_SECONDS
    while True:
        try:
            os.replace(source, target)
            return
        except PermissionError:
            if time.monotonic() >= end:
                raise
        time.sleep(0.05)


def _keep(target: Path) -> Path | None:
    """A second name for an existing file: the target itself is never missing, whenever the process dies."""
    if not target.exists():
        return None
    backup = _temporary_name(target.parent, target.suffix)
    try:
        os.link(target, backup)
    except OSError:  # file systems without hard links
        shutil.copy2(target, backup)
    return backup


def _remove_stale(folder: Path) -> None:
    for path in folder.iterdir():
        made_by = _TEMPORARY.match(path.name)
        if made_by and made_by[1] == _HOST and not _is_running(int(made_by[2])):
            with suppress(PermissionError):  # on Windows, while somebody has it open
                path.unlink(missing_ok=True)


if sys.platform == "win32":
    import ctypes
    import msvcrt

    def _is_running(process: int) -> bool:
        query_limited_information = 0x1000
        handle = ctypes.windll.kernel32.OpenProcess(query_limited_information, False, process)
        if handle:
            ctypes.windll.kernel32.CloseHandle(handle)
        return bool(handle)

    def _try_lock(file: IO[bytes]) -> bool:
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except PermissionError:
            return False
        return True

else:
    import fcntl

    def _is_running(process: int) -> bool:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return False
        except PermissionError:  # someone else's, but there
            return True
        return True

    def _try_lock(file: IO[bytes]) -> bool:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


class _FolderLock:
    """A lock that the operating system drops with the process, so that a dead bake never blocks the next."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / LOCK_NAME
        try:
            while True:
                self._file = self._path.open("ab")
                if not _try_lock(self._file):
                    self._file.close()
                    raise OutputError(
                        str(folder), "another bake is writing to this folder", "Wait for it, or choose another folder"
                    )
                if self._is_current():
                    return
                self._file.close()  # its last holder removed it after we opened it
        except OSError as error:
            raise _output_error(folder, error) from error

    def _is_current(self) -> bool:
        try:
            return not OPEN_FILES_GO or os.path.samestat(os.fstat(self._file.fileno()), self._path.stat())
        except FileNotFoundError:
            return False

    def release(self) -> None:
        if not OPEN_FILES_GO:
            self._file.close()
            with suppress(PermissionError):  # another bake has opened it since
                self._path.unlink(missing_ok=True)
        else:
            self._path.unlink(missing_ok=True)
            self._file.close()
