"""Writes the pieces of an export to files."""
from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import IO

from kinevox.recordings import ExportPiece

OnProgress = Callable[[float], None]


class ExportFiles:
    """Each file is written aside and renamed when it is whole. written: the files; remarks: what there is to know.
    on_progress is told the share of the files, 0 to 1, that the daemon has made."""

    def __init__(self, to: Path, on_progress: OnProgress | None = None) -> None:
        self.written: list[Path] = []
        self.remarks: list[str] = []
        self._one = to.suffix != "" and not to.is_dir()
        self._to = to
        self._on_progress = on_progress
        self._file: IO[bytes] | None = None
        self._aside = to

    def take(self, piece: ExportPiece) -> None:
        """The next piece."""
        if not piece.file_name:
            if self._on_progress is not None:
                self._on_progress(piece.done_share)
            return
        folder = self._to.parent if self._one else self._to
        # The name comes from the network: never a path.
        target = self._to if self._one and not self.written else folder / Path(piece.file_name).name
        if self._file is None:
            folder.mkdir(parents=True, exist_ok=True)
            self._aside = target.with_name(f".{target.name}.{os.getpid()}.part")
            self._file = open(self._aside, "wb")
        self._file.write(piece.data)
        if not piece.last:
            return
        self._file.close()
        self._file = None
        self._aside.replace(target)
        self.written.append(target)
        if piece.remark:
            self.remarks.append(piece.remark)

    def __enter__(self) -> "ExportFiles":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self._file is not None:
            self._file.close()
            self._aside.unlink(missing_ok=True)
