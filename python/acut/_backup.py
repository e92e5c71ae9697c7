"""Files of a backup, as they come, and of an export that is imported."""
import os
import re
from dataclasses import dataclass
from typing import Any, List, Tuple

from . import _abi as abi
from . import _library
from ._errors import InputError
from ._library import State, decoded, guard


@dataclass(frozen=True)
class BackupFile:
    """One file of a backup. It can be read (os.dup, os.pread, shutil) until the function that got it returns."""
    name: str      # relative, with "/"; nothing in it climbs
    size: int
    lasting: bool  # a file of this name never has other bytes
    fd: int

    def fileno(self) -> int:
        return self.fd


def backup_sink(state: State, each: Any) -> Any:
    def file(ctx: int, at: int) -> None:
        f = abi.acut_backup_file.from_address(at)
        each(BackupFile(decoded(f.name), f.size, f.lasting, f.fd))

    sink = abi.acut_backup_sink()
    sink.file = dict(abi.acut_backup_sink._fields_)["file"](guard(state, file, 2))
    return sink


class _Giver:
    """Gives files one after the other, each with a name; `files`: names and paths."""

    def __init__(self, state: State, kind: Any, files: List[Tuple[str, str]]) -> None:
        self.files, self.fd, self.text = files, -1, b""  # type: List[Tuple[str, str]], int, bytes
        self.next = kind(guard(state, self._next, 3))

    def _next(self, ctx: int, ret_name: int, ret_fd: int) -> None:
        self.close()
        if self.files:
            name, path = self.files.pop(0)
            self.fd, self.text = os.open(path, os.O_RDONLY | os.O_CLOEXEC), os.fsencode(name)
            abi.c_char_p.from_address(ret_name).value = self.text
            abi.c_int.from_address(ret_fd).value = self.fd

    def close(self) -> None:
        if self.fd >= 0:
            os.close(self.fd)
        self.fd = -1


class FileGiver(_Giver):
    """Files anywhere; their names are for messages."""

    def __init__(self, state: State, paths: List[str]) -> None:
        super().__init__(state, _library.library().acut_cache_adopt.argtypes[1], [(path, path) for path in paths])


# As acutctl chooses them: segments, files of sources, and files of lines, which are named by the numbers of their sources.
_OF_DATASET = re.compile(r"[^.].*\.seg|sources(-[^.]*)?|(lines|lineset|places)-[0-9]+", re.DOTALL)


class Giver(_Giver):
    """The files of an exported dataset, "manifest" first."""

    def __init__(self, state: State, folder: str) -> None:
        others = sorted(n for n in os.listdir(folder) if _OF_DATASET.fullmatch(n))
        if not os.path.exists(os.path.join(folder, "manifest")):
            raise InputError("there is no file manifest in this folder", file=folder,
                             hint="give a folder that acutctl dataset export has written to its end")
        super().__init__(state, _library.library().acut_import.argtypes[2],
                         [(name, os.path.join(folder, name)) for name in ["manifest"] + others])
