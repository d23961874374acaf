"""Writes the pieces of an export to files."""
from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import IO

from kinevox.recordings import ExportPiece


class ExportFiles:
    """Each file is written aside and renamed when it is whole. written: the files; remarks: what there is to know."""

    def __init__(self, to: Path) -> None:
        self.written: list[Path] = []
        self.remarks: list[str] = []
        self._one = to.suffix != "" and not to.is_dir()
        self._to = to
        self._file: IO[bytes] | None = None
        self._aside = to

    def take(self, piece: ExportPiece) -> None:
        """The next piece."""
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
